//! How strategies are written in a file of rules. Their bounds are in `proposals.rs`.

use zk0_protocol::rules::network_rules::Strategy;
use zk0_testkit::network::genesis;

pub fn multi_krum(byzantine_bps: u32, keep_bps: u32) -> Strategy {
    Strategy::MultiKrum {
        byzantine_bps,
        keep_bps,
    }
}

pub fn momentum(server_rate_bps: u32, momentum_bps: u32) -> Strategy {
    Strategy::FedAvgM {
        server_rate_bps,
        momentum_bps,
    }
}

pub fn adam(
    server_rate_billionths: u32,
    beta1_bps: u32,
    beta2_bps: u32,
    tau_billionths: u32,
) -> Strategy {
    Strategy::FedAdam {
        server_rate_billionths,
        beta1_bps,
        beta2_bps,
        tau_billionths,
    }
}

/// The limits of the strategies' parameters are themselves allowed, and the names in a file of rules are these.
#[test]
fn every_strategy_can_be_written_in_a_file_of_rules() {
    for (strategy, text) in [
        (Strategy::FedAvg, r#""fed-avg""#),
        (Strategy::Median, r#""median""#),
        (
            Strategy::TrimmedMean { trim_bps: 4999 },
            r#"{"trimmed-mean":{"trim_bps":4999}}"#,
        ),
        (
            Strategy::Krum {
                byzantine_bps: 4999,
            },
            r#"{"krum":{"byzantine_bps":4999}}"#,
        ),
        (
            multi_krum(1, 10_000),
            r#"{"multi-krum":{"byzantine_bps":1,"keep_bps":10000}}"#,
        ),
        (
            multi_krum(4999, 1),
            r#"{"multi-krum":{"byzantine_bps":4999,"keep_bps":1}}"#,
        ),
        (
            Strategy::NormClipping {
                max_norm_bps: 1_000_000,
            },
            r#"{"norm-clipping":{"max_norm_bps":1000000}}"#,
        ),
        (
            momentum(100_000, 9999),
            r#"{"fed-avg-m":{"server_rate_bps":100000,"momentum_bps":9999}}"#,
        ),
        (
            momentum(1, 0),
            r#"{"fed-avg-m":{"server_rate_bps":1,"momentum_bps":0}}"#,
        ),
        (
            adam(1, 0, 0, 1),
            r#"{"fed-adam":{"server_rate_billionths":1,"beta1_bps":0,"beta2_bps":0,"tau_billionths":1}}"#,
        ),
        (
            adam(1_000_000_000, 9999, 9999, 1_000_000_000),
            r#"{"fed-adam":{"server_rate_billionths":1000000000,"beta1_bps":9999,"beta2_bps":9999,"tau_billionths":1000000000}}"#,
        ),
    ] {
        assert_eq!(serde_json::to_string(&strategy).unwrap(), text);
        assert_eq!(serde_json::from_str::<Strategy>(text).unwrap(), strategy);
        let mut rules = genesis().rules;
        rules.strategy = strategy;
        assert_eq!(rules.check(), Ok(()), "{text}");
    }
}
