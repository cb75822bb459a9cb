//! A refusal for the refused node and the program's log: the ledger's code, and details for people.

use crate::entries::refusal::code::RefusalCode;
use std::fmt;

pub mod claim_field;
pub mod code;

/// Why a contribution does not count. Refusals are equal if their codes are.
#[derive(Clone, Debug, Eq, thiserror::Error)]
pub struct Refusal {
    /// The code on the ledger.
    pub code: RefusalCode,
    /// Other details, such as a library's words; may be empty. For people, and never on the ledger.
    pub detail: String,
}

impl PartialEq for Refusal {
    fn eq(&self, other: &Self) -> bool {
        self.code == other.code
    }
}

impl From<RefusalCode> for Refusal {
    fn from(code: RefusalCode) -> Self {
        code.because("")
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.detail.is_empty() {
            self.code.fmt(f)
        } else {
            write!(f, "{}: {}", self.code, self.detail)
        }
    }
}

impl RefusalCode {
    /// The refusal with this code and detail.
    pub fn because(self, detail: impl fmt::Display) -> Refusal {
        let detail = detail.to_string();
        Refusal { code: self, detail }
    }
}
