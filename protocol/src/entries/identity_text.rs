//! Identities in JSON: hexadecimal text.

use crate::quote::short;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serializer};
use zk0_circuits::NodeId;

/// Writes an identity.
pub fn serialize<S: Serializer>(id: &NodeId, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(id)
}

/// Reads an identity.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<NodeId, D::Error> {
    parse(&String::deserialize(deserializer)?)
}

fn parse<E: Error>(text: &str) -> Result<NodeId, E> {
    text.parse().map_err(|_| {
        let text = short(text);
        E::custom(format!(
            "'{text}' is not an identity, which has 64 hexadecimal digits"
        ))
    })
}

/// Lists of identities.
pub mod list {
    use super::*;

    /// Writes a list.
    pub fn serialize<S: Serializer>(ids: &[NodeId], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(ids.iter().map(NodeId::to_string))
    }

    /// Reads a list.
    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<NodeId>, D::Error> {
        let texts = Vec::<String>::deserialize(deserializer)?;
        texts.iter().map(|text| parse(text)).collect()
    }
}
