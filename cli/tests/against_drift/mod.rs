//! `zk0 node join` where the nodes' recordings differ much: FedCM, and SCAFFOLD where the rules ask for it.

mod fedcm;
mod scaffold;
