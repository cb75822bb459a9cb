//! `zk0 audit show`.

use super::{ends, export};
use crate::harness::made_ledger::{Made, NAMES};
use crate::harness::{json, prints, text};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::Body;

#[test]
fn what_happened_is_shown_in_words_and_tables() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, out) = (scratch.path().join("ledger"), scratch.path().join("out"));
    let mut made = Made::found(&dir, 0);
    made.round();
    made.append(Body::NodeEnrolled(NodeEnrolled {
        node: Made::id(9),
        name: "quiet".into(),
    }));
    drop(made.ledger);
    export(&dir, &out);
    for ledger in [text(&dir), text(&out)] {
        let all = prints(&["audit", "show", ledger]);
        for words in [
            "zk0.example/audit<test>",
            NAMES[0],
            "malformed proof",
            "quiet",
            "randomness  the VRF of the log's key",
            "unanswered",
        ] {
            assert!(all.contains(words), "{words}: {all}");
        }
        let one = prints(&["audit", "show", ledger, "8"]);
        assert!(one.contains("committed to an update in round 0"), "{one}");
        let gone = ends(1, &["audit", "show", ledger, "1000"]).1;
        assert!(gone.contains("there is no entry 1000"), "{gone}");
        let round = json(&["audit", "show", ledger, "--round", "0", "--json"]);
        assert_eq!(round["round"]["refused"], 3);
        assert_eq!(round["entries"].as_array().unwrap().len(), 10);
        let randomness = round["round"]["randomness"].as_str().unwrap();
        assert!(randomness.starts_with("the VRF of the log's key: "));
        let gone = ends(1, &["audit", "show", ledger, "--round", "1"]).1;
        assert!(gone.contains("there is no round 1"), "{gone}");
        let id = Made::id(9).to_string();
        for node in ["quiet", &id[..8]] {
            let node = json(&["audit", "show", ledger, "--node", node, "--json"]);
            assert_eq!(node["node"]["name"], "quiet");
            assert_eq!(node["entries"].as_array().unwrap().len(), 1);
        }
        let nobody = ends(1, &["audit", "show", ledger, "--node", "nobody"]).1;
        assert!(nobody.contains("no node is called"), "{nobody}");
        let entries = json(&["audit", "show", ledger, "--entries", "--json"]);
        assert_eq!(entries["entries"].as_array().unwrap().len(), 18);
        assert_eq!(entries["entries"][0]["kind"], "genesis");
    }
}
