//! What a ledger hands out, verified by implementations that are not ours.

mod go;
mod tree;
