//! A node to enrol, as the command line names it.

use anyhow::{bail, Result};
use std::str::FromStr;
use zk0_circuits::NodeId;
use zk0_protocol::entries::member::NodeEnrolled;

/// A node to enrol, `NAME=IDENTITY`.
#[derive(Clone, Debug)]
pub struct Enrolment {
    /// A name for people.
    pub name: String,
    /// Its identity: the public half of its key.
    pub node: NodeId,
}

impl FromStr for Enrolment {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let Some((name, node)) = text.split_once('=') else {
            bail!("'{text}' is not of the form NAME=IDENTITY");
        };
        Ok(Self {
            name: name.into(),
            node: node.parse()?,
        })
    }
}

impl From<&Enrolment> for NodeEnrolled {
    fn from(Enrolment { name, node }: &Enrolment) -> Self {
        Self {
            node: *node,
            name: name.clone(),
        }
    }
}
