//! A refusal, as the node that is refused and the log of the program get it: the code that the ledger records, and details for people.

use crate::entries::refusal::code::RefusalCode;
use std::fmt;

pub mod claim_field;
pub mod code;

/// Why a contribution does not count. Two refusals are equal where their codes are: the detail decides nothing.
#[derive(Clone, Debug, Eq, thiserror::Error)]
pub struct Refusal {
    /// What the ledger records.
    pub code: RefusalCode,
    /// What else is known, such as the words of a library; empty where nothing is. It is for people and never goes on the ledger.
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
    /// The refusal with this code and this detail for people.
    pub fn because(self, detail: impl fmt::Display) -> Refusal {
        let detail = detail.to_string();
        Refusal { code: self, detail }
    }
}
