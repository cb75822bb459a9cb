//! `zk0 audit` as its users run it: on the committed ledger, which holds a real proof, and on ledgers made here, whose nodes have
//! hostile names and whose log forks.

use ed25519_dalek::SigningKey;
use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};
use zk0_circuits::{
    model::spec::EvalSpec, DatasetCommitment, Digest, Losses, Mode, NodeId, WeightsDigest,
};
use zk0_ledger::{folder, Ledger};
use zk0_protocol::{
    entries::{
        entry::RoundClosed,
        member::NodeEnrolled,
        signed::{DatasetRegistration, Submission, UpdateCommitment},
    },
    rules::network_rules::CreditRule,
    tlog::{checkpoint::Parsed, cosigner::Cosigner},
    Body, Genesis, Refusal, Rules, Signed,
};

const LEDGER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/fixtures/ledger");

fn zk0(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_zk0"))
        .args(arguments)
        .output()
        .unwrap()
}

/// Standard output and error of a command that ends with this code.
#[track_caller]
fn ends(code: i32, arguments: &[&str]) -> (String, String) {
    let output = zk0(arguments);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let complained = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(
        output.status.code(),
        Some(code),
        "{arguments:?}: {said}{complained}"
    );
    (said, complained)
}

#[track_caller]
fn succeeds(arguments: &[&str]) -> String {
    ends(0, arguments).0
}

#[track_caller]
fn json(arguments: &[&str]) -> serde_json::Value {
    serde_json::from_str(&succeeds(arguments)).unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A ledger whose entries follow the rules and whose proofs are none.
struct Made {
    ledger: Ledger,
    time_ms: u64,
    seed: u8,
    /// What refusals say; then all but the last node are accepted. If there is nothing, all are refused for the true reason.
    lie: Option<&'static str>,
}

/// What nodes submit instead of proofs begins so.
const NO_PROOF: &[u8; 4] = b"none";

const NAMES: [&str; 3] = [
    "<script>alert(1)</script>",
    "\"><img src=x onerror=alert(1)>",
    "&lt;b&gt; Zoë's arm",
];

impl Made {
    fn node(node: u8) -> SigningKey {
        SigningKey::from_bytes(&[100 + node; 32])
    }

    fn id(node: u8) -> NodeId {
        NodeId(Self::node(node).verifying_key().to_bytes())
    }

    fn found(dir: &Path, seed: u8) -> Self {
        Self::found_with(dir, seed, [9; 32], String::new())
    }

    fn found_with(dir: &Path, seed: u8, nonce: [u8; 32], witness_policy: String) -> Self {
        let key = SigningKey::from_bytes(&[7; 32]);
        let genesis = Genesis {
            name: "zk0.example/audit<test>".into(),
            log_key: key.verifying_key().to_bytes(),
            nonce,
            rules: Rules {
                min_dataset_samples: 4,
                eval_samples: 2,
                min_improvement_bps: 50,
                max_weight_samples: 100,
                commit_window_ms: 1_000,
                submit_window_ms: 5_000,
                credits: CreditRule {
                    bps_samples_per_credit: 100,
                    max_per_contribution: 1000,
                    dispute_window_ms: 1000,
                },
                witness_policy,
                ..Rules::default()
            },
            program: vec![0; 32],
            mode: Mode::Direct,
            evaluation: EvalSpec::micro().encode(),
            policy: Digest([3; 32]),
            initial: weights(4, 0),
        };
        let time_ms = 1_700_000_000_000;
        let (ledger, _) = Ledger::create(dir, genesis, key, time_ms).unwrap();
        let mut made = Self {
            ledger,
            time_ms,
            seed,
            lie: None,
        };
        for (node, name) in (0..).zip(NAMES) {
            made.append(Body::NodeEnrolled(NodeEnrolled {
                node: Self::id(node),
                name: name.into(),
            }));
            let registration = DatasetRegistration {
                network: *made.ledger.state().network(),
                node: Self::id(node),
                dataset: DatasetCommitment {
                    root: Digest([0x20 + node; 32]),
                    samples: 10 + u64::from(node),
                    feature_spec: Digest([5; 32]),
                    salt_commitment: Digest([0x40 + node; 32]),
                },
                leaves: Digest([0x60 + node; 32]),
                episodes: vec![Digest([node; 32])],
            };
            made.append(Body::DatasetCommitted(Signed::new(
                registration,
                &Self::node(node),
            )));
        }
        made
    }

    fn append(&mut self, body: Body) {
        self.time_ms += 1;
        self.ledger.append(self.time_ms, body).unwrap();
    }

    /// A round.
    fn round(&mut self) {
        let state = self.ledger.state();
        let (network, round) = (*state.network(), state.next_round());
        let opened = state.next_opening(self.time_ms + 1).unwrap();
        let base = opened.base;
        self.append(Body::RoundOpened(opened));
        for node in 0..NAMES.len() as u8 {
            let commitment = UpdateCommitment {
                network,
                round,
                node: Self::id(node),
                dataset_root: Digest([0x20 + node; 32]),
                update: weights(0x10 + node, self.seed),
            };
            self.append(Body::UpdateCommitted(Signed::new(
                commitment,
                &Self::node(node),
            )));
        }
        for node in 0..NAMES.len() as u8 {
            let expected = self.ledger.state().expected_claim(&Self::id(node)).unwrap();
            let claim = expected.with(Losses::Disclosed {
                before: 4_000_000_000 / (round + 2),
                after: 4_000_000_000 / (round + 3),
                elements: 10,
            });
            let proof = self
                .ledger
                .blobs()
                .put(&[NO_PROOF, &[node][..]].concat())
                .unwrap();
            let submission = Signed::new(Submission { claim, proof }, &Self::node(node));
            let truth = format!("unknown kind of proof {}", u32::from_le_bytes(*NO_PROOF));
            let last = usize::from(node) + 1 == NAMES.len();
            self.append(match self.lie {
                Some(_) if !last => Body::ContributionAccepted(submission),
                lie => Body::ContributionRejected {
                    submission,
                    reason: Refusal::MalformedProof(lie.map_or(truth, str::to_owned)),
                },
            });
        }
        let contributors = self.ledger.state().contributors();
        self.append(Body::RoundClosed(RoundClosed {
            round,
            global: match contributors.is_empty() {
                true => base,
                false => weights(round as u8, 0x33),
            },
            contributors,
        }));
    }
}

fn weights(byte: u8, seed: u8) -> WeightsDigest {
    WeightsDigest {
        blob: Digest([byte ^ seed; 32]),
        quantised: Digest([byte ^ seed ^ 0x80; 32]),
    }
}

/// Names of the files in a folder.
fn names(dir: &Path) -> BTreeSet<String> {
    let name =
        |found: std::io::Result<fs::DirEntry>| found.unwrap().file_name().into_string().unwrap();
    fs::read_dir(dir).unwrap().map(name).collect()
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for found in fs::read_dir(from).unwrap() {
        let found = found.unwrap();
        let place = to.join(found.file_name());
        match found.path().is_dir() {
            true => copy(&found.path(), &place),
            false => drop(fs::copy(found.path(), place).unwrap()),
        }
    }
}

fn export(ledger: &Path, out: &Path) {
    succeeds(&["ledger", "export", text(ledger), text(out)]);
}

#[test]
fn a_light_audit_fetches_no_weights_and_says_what_it_left_out() {
    let scratch = tempfile::tempdir().unwrap();
    let (out, kept) = (scratch.path().join("out"), scratch.path().join("kept"));
    export(Path::new(LEDGER), &out);
    let full = json(&["audit", "replay", LEDGER, "--json"]);
    assert_eq!(
        (&full["verdict"], &full["depth"]),
        (&"verified".into(), &"full".into())
    );
    assert!(full["checked"]["proofs"].as_u64() >= Some(1));
    let light = json(&[
        "audit",
        "replay",
        text(&out),
        "--light",
        "--json",
        "--mirror",
        text(&kept),
    ]);
    assert_eq!(
        (&light["verdict"], &light["depth"]),
        (&"verified".into(), &"light".into())
    );
    assert_eq!(light["checked"]["proofs"], full["checked"]["proofs"]);
    assert_eq!(light["checked"]["updates"], 0);
    assert!(light["not_checked"].as_array().unwrap().len() >= 4);
    let fetched = names(&kept.join("blobs/sha256"));
    let proofs = light["checked"]["proofs"].as_u64().unwrap()
        + light["checked"]["refusals"].as_u64().unwrap();
    assert_eq!(fetched.len() as u64, proofs, "{fetched:?}");
    assert!(fetched.len() < names(&out.join("blobs/sha256")).len());
    assert_eq!(
        json(&["audit", "replay", LEDGER, "--light", "--json"]),
        light
    );
    let said = succeeds(&["audit", "replay", LEDGER, "--light"]);
    assert!(
        said.contains("it did not read weights, so it checked no averages"),
        "{said}"
    );
    assert!(said.contains("this audit is light"), "{said}");
    let folder = ends(1, &["audit", "replay", LEDGER, "--mirror", text(&kept)]).1;
    assert!(folder.contains("--mirror is for an export"), "{folder}");
}

#[test]
fn an_audit_with_a_memory_reads_what_is_new_and_ends_the_same() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, state) = (scratch.path().join("ledger"), scratch.path().join("state"));
    let mut made = Made::found(&dir, 0);
    made.round();
    drop(made.ledger);
    let replay = |ledger: &Path| {
        json(&[
            "audit",
            "replay",
            text(ledger),
            "--json",
            "--state",
            text(&state),
        ])
    };
    let whole = |ledger: &Path| json(&["audit", "replay", text(ledger), "--json"]);
    let older = scratch.path().join("older");
    copy(&dir, &older);
    assert_eq!(replay(&dir), whole(&dir));
    let key = SigningKey::from_bytes(&[7; 32]);
    let ledger = Ledger::open(&dir, None, key).unwrap();
    let time_ms = ledger.state().time_ms();
    let mut made = Made {
        ledger,
        time_ms,
        seed: 0x0f,
        lie: None,
    };
    made.round();
    drop(made.ledger);
    assert_eq!(replay(&dir), whole(&dir));
    let (_, log) = ends(0, &["audit", "replay", text(&dir), "--state", text(&state)]);
    assert!(log.contains("23 entries were verified before"), "{log}");
    // Back to an older copy, or another history: named, and remembered still.
    let options = ["--state", text(&state)];
    let replay = |ledger: &Path| {
        ends(
            1,
            &[&["audit", "replay", text(ledger)][..], &options].concat(),
        )
        .0
    };
    let said = replay(&older);
    assert!(
        said.contains("ROLLED BACK") && said.contains("FAILED"),
        "{said}"
    );
    let fork = scratch.path().join("fork");
    let mut made = Made::found(&fork, 0x0c);
    (0..3).for_each(|_| made.round());
    drop(made.ledger);
    let said = replay(&fork);
    assert!(said.contains("FORKED"), "{said}");
    let stranger = scratch.path().join("stranger");
    drop(Made::found_with(&stranger, 0, [10; 32], String::new()).ledger);
    let said = replay(&stranger);
    assert!(said.contains("is of network"), "{said}");
    // A light memory is none for a full audit, a damaged one for nobody: both begin anew, and say so.
    let (said, log) = ends(
        0,
        &[
            "audit",
            "replay",
            text(&dir),
            "--light",
            "--state",
            text(&state),
        ],
    );
    assert!(
        log.contains("the state file is from a full audit, and this audit is light"),
        "{log}"
    );
    assert!(said.contains("VERIFIED"), "{said}");
    let mut bytes = fs::read(&state).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&state, bytes).unwrap();
    let (said, log) = ends(0, &["audit", "replay", text(&dir), "--state", text(&state)]);
    assert!(log.contains("it is damaged"), "{log}");
    assert!(said.contains("entries      23"), "{said}");
}

#[test]
fn a_report_for_browsers_holds_no_script_and_loads_nothing() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, page) = (
        scratch.path().join("ledger"),
        scratch.path().join("report.html"),
    );
    let mut made = Made::found(&dir, 0);
    made.round();
    made.round();
    drop(made.ledger);
    succeeds(&["audit", "replay", text(&dir), "--html", text(&page)]);
    let html = fs::read_to_string(&page).unwrap();
    for hostile in ["<script", "<img", "onerror=alert(1)>", "javascript:"] {
        assert!(!html.to_lowercase().contains(hostile), "{hostile}");
    }
    for shown in [
        "&lt;script&gt;alert(1)&lt;/script&gt;",
        "&amp;lt;b&amp;gt; Zoë&#39;s arm",
        "audit&lt;test&gt;",
        "VERIFIED",
        "Not checked:",
        "malformed proof",
    ] {
        assert!(html.contains(shown), "{shown}");
    }
    // Every '<' is this program's: known elements, none of which loads anything or listens.
    for tag in html.split('<').skip(1) {
        let tag = tag.split('>').next().unwrap();
        let name = tag
            .trim_start_matches('/')
            .split_whitespace()
            .next()
            .unwrap();
        assert!(ELEMENTS.contains(&name), "<{tag}>");
        for attribute in ["src=", "href", "url(", " on", "http:", "https:"] {
            assert!(!tag.contains(attribute), "<{tag}>");
        }
    }
    assert!(!html.contains("url(") && !html.contains("@import"));
    assert!(html.contains("default-src 'none'"));
    assert!(html.matches("<svg").count() >= 3);
    for element in [
        "svg", "table", "tr", "td", "figure", "ul", "li", "p", "div", "text",
    ] {
        let opened = html.matches(&format!("<{element} ")).count()
            + html.matches(&format!("<{element}>")).count();
        assert_eq!(
            opened,
            html.matches(&format!("</{element}>")).count(),
            "{element}"
        );
    }
    let data = fs::read(page.with_extension("json")).unwrap();
    let data: serde_json::Value = serde_json::from_slice(&data).unwrap();
    assert_eq!(data["audit"]["verdict"], "verified");
    assert_eq!(data["history"]["rounds"].as_array().unwrap().len(), 2);
    assert_eq!(data["history"]["nodes"][0]["name"], NAMES[0]);
    assert_eq!(data["history"]["refusals"]["malformed proof"], 6);
    // The verdict is the audit's, and it quotes what it found.
    let lies = scratch.path().join("lies");
    let mut made = Made::found(&lies, 0);
    made.lie = Some("<script>because()</script>");
    (0..12).for_each(|_| made.round());
    drop(made.ledger);
    ends(1, &["audit", "replay", text(&lies), "--html", text(&page)]);
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.contains("FAILED") && html.contains("class=\"fault\""));
    assert!(html.contains("&lt;script&gt;because") && !html.contains("<script"));
    // Contributions, reasons, credits and losses.
    assert_eq!(html.matches("<svg").count(), 4);
    assert_eq!(html.matches("<polyline").count(), 4);
}

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
        let all = succeeds(&["audit", "show", ledger]);
        for words in [
            "zk0.example/audit<test>",
            NAMES[0],
            "malformed proof",
            "quiet",
        ] {
            assert!(all.contains(words), "{words}: {all}");
        }
        let one = succeeds(&["audit", "show", ledger, "8"]);
        assert!(one.contains("committed to an update in round 0"), "{one}");
        let gone = ends(1, &["audit", "show", ledger, "1000"]).1;
        assert!(gone.contains("there is no entry 1000"), "{gone}");
        let round = json(&["audit", "show", ledger, "--round", "0", "--json"]);
        assert_eq!(round["round"]["refused"], 3);
        assert_eq!(round["entries"].as_array().unwrap().len(), 8);
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
        assert_eq!(entries["entries"].as_array().unwrap().len(), 16);
        assert_eq!(entries["entries"][0]["kind"], "genesis");
    }
}

/// The elements of a report.
const ELEMENTS: &[&str] = &[
    "!DOCTYPE",
    "html",
    "head",
    "meta",
    "title",
    "style",
    "body",
    "h1",
    "h2",
    "div",
    "code",
    "b",
    "br",
    "p",
    "ul",
    "li",
    "table",
    "thead",
    "tbody",
    "tr",
    "th",
    "td",
    "figure",
    "figcaption",
    "svg",
    "text",
    "rect",
    "line",
    "polyline",
    "circle",
];

/// `audit watch`, one look.
fn look(code: i32, log: &Path, state: &Path, more: &[&str]) -> String {
    let watch = [
        "audit",
        "watch",
        text(log),
        "--looks",
        "1",
        "--state",
        text(state),
    ];
    ends(code, &[&watch[..], more].concat()).0
}

#[test]
fn a_watch_tells_what_is_new_and_remembers_what_it_saw() {
    let scratch = tempfile::tempdir().unwrap();
    let place = |name: &str| scratch.path().join(name);
    let (dir, state) = (place("ledger"), place("state"));
    let mut made = Made::found(&dir, 0);
    made.round();
    let export_as = |name: &str| -> PathBuf {
        let out = place(name);
        export(&dir, &out);
        out
    };
    let first = export_as("first");
    let said = look(0, &first, &state, &[]);
    assert!(said.contains("verified     15 entries"), "{said}");
    assert_eq!(look(0, &first, &state, &[]), "", "nothing is new");
    made.round();
    drop(made.ledger);
    let second = export_as("second");
    let said = look(0, &second, &state, &[]);
    assert_eq!(said.lines().count(), 8, "{said}");
    assert!(said.contains("round 1 closed"), "{said}");
    // The folder itself, by the same memory.
    assert_eq!(look(0, &dir, &state, &[]), "");
    // Back, forked, damaged: loud, and the memory stays.
    let kept = fs::read(&state).unwrap();
    let said = look(1, &first, &state, &[]);
    assert!(
        said.contains("ALARM") && said.contains("ROLLED BACK"),
        "{said}"
    );
    let said = look(1, &first, &state, &["--json"]);
    assert!(said.contains("\"event\":\"alarm\""), "{said}");
    let (forked, fork) = (place("forked"), place("fork"));
    let mut made = Made::found(&forked, 0x0c);
    (0..3).for_each(|_| made.round());
    drop(made.ledger);
    export(&forked, &fork);
    let said = look(1, &fork, &state, &[]);
    assert!(said.contains("ALARM") && said.contains("FORKED"), "{said}");
    assert_eq!(fs::read(&state).unwrap(), kept);
    // A proof that is not what its name says.
    let blobs = export_as("false-proof").join("blobs/sha256");
    let proof = fs::read_dir(blobs).unwrap().next().unwrap().unwrap();
    fs::write(proof.path(), b"another proof").unwrap();
    let said = look(1, &place("false-proof"), &place("new"), &[]);
    assert!(said.contains("ALARM") && said.contains("SHA-256"), "{said}");
    // A kept mirror notices by itself, without the memory.
    let (mirror, other) = (place("mirror"), place("other"));
    look(0, &second, &other, &["--mirror", text(&mirror)]);
    fs::remove_file(&other).unwrap();
    let said = look(1, &first, &other, &["--mirror", text(&mirror)]);
    assert!(said.contains("ROLLED BACK"), "{said}");
    // A lost memory is for its owner to judge.
    let mut damaged = kept.clone();
    damaged[100] ^= 1;
    fs::write(&state, damaged).unwrap();
    let arguments = [
        "audit",
        "watch",
        text(&second),
        "--looks",
        "1",
        "--state",
        text(&state),
    ];
    let (_, why) = ends(1, &arguments);
    assert!(why.contains("remove the file to begin anew"), "{why}");
    // Nobody answers: no alarm, but not well either.
    fs::write(&state, kept).unwrap();
    let arguments = [
        "audit",
        "watch",
        "http://127.0.0.1:9",
        "--looks",
        "1",
        "--state",
        text(&state),
    ];
    let (said, why) = ends(1, &arguments);
    assert!(
        !said.contains("ALARM") && why.contains("gave no answer"),
        "{said}{why}"
    );
}

#[test]
fn a_watch_wants_the_quorum_it_was_told_to() {
    let scratch = tempfile::tempdir().unwrap();
    let place = |name: &str| scratch.path().join(name);
    let (dir, out, policy) = (place("ledger"), place("out"), place("policy"));
    drop(Made::found(&dir, 0).ledger);
    export(&dir, &out);
    let witness = succeeds(&[
        "witness",
        "keygen",
        text(&place("w.key")),
        "--name",
        "witness.example/w",
    ]);
    fs::write(&policy, format!("witness W {witness}quorum W\n")).unwrap();
    for log in [&out, &dir] {
        let said = look(1, log, &place("state"), &["--policy", text(&policy)]);
        assert!(
            said.contains("ALARM") && said.contains("cosigned by none"),
            "{said}"
        );
    }
}

/// The log's key signs alone what the rules want cosigned: whoever reads the published log notices without being told to.
#[test]
fn the_networks_own_rules_ask_for_witnesses() {
    let scratch = tempfile::tempdir().unwrap();
    let place = |name: &str| scratch.path().join(name);
    let (dir, out) = (place("ledger"), place("out"));
    let cosigner = Cosigner::new("witness.example/w", SigningKey::from_bytes(&[55; 32])).unwrap();
    let policy = format!(
        "witness W {} http://127.0.0.1:1\nquorum W\n",
        cosigner.key()
    );
    drop(Made::found_with(&dir, 0, [9; 32], policy).ledger);
    // Nothing is published without them, from the folder or through it.
    for arguments in [
        &["ledger", "export", text(&dir), text(&out)][..],
        &["ledger", "import", text(&dir), text(&place("copy"))],
        &["audit", "prove", text(&dir), "0"],
    ] {
        let (_, why) = ends(1, arguments);
        assert!(
            why.contains("before the witnesses have cosigned"),
            "{arguments:?}: {why}"
        );
    }
    // The folder itself may be audited, and the report says what that leaves out.
    let said = succeeds(&["audit", "replay", text(&dir)]);
    assert!(said.contains("cosignatures were not looked at"), "{said}");
    let signed = folder::read_checkpoint(&dir).unwrap().unwrap();
    let parsed = Parsed::read(&signed).unwrap();
    let cosignature = cosigner.cosign(parsed.note.text(), 1_700_000_000);
    folder::write_cosigned(&dir, &[&signed[..], &cosignature].concat()).unwrap();
    export(&dir, &out);
    let said = succeeds(&["audit", "replay", text(&out)]);
    assert!(!said.contains("cosignatures were not"), "{said}");
    succeeds(&["ledger", "import", text(&out), text(&place("copy"))]);
    look(0, &out, &place("state"), &[]);
    // A published log that lost its cosignatures convinces nobody who was not told otherwise.
    fs::write(out.join("checkpoint"), &signed).unwrap();
    for arguments in [
        &["audit", "replay", text(&out)][..],
        &["ledger", "import", text(&out), text(&place("copy"))],
        &["ledger", "import", text(&out), text(&place("fresh"))],
    ] {
        let (_, why) = ends(1, arguments);
        assert!(
            why.contains("lacks the cosignatures"),
            "{arguments:?}: {why}"
        );
    }
    let said = look(1, &out, &place("state"), &[]);
    assert!(
        said.contains("ALARM") && said.contains("lacks the cosignatures"),
        "{said}"
    );
    fs::write(place("any"), "quorum none\n").unwrap();
    succeeds(&[
        "audit",
        "replay",
        text(&out),
        "--policy",
        text(&place("any")),
    ]);
    // Nor is it served without them.
    let key = place("log.key");
    fs::write(&key, format!("{}\n", "07".repeat(32))).unwrap();
    let (_, why) = ends(
        1,
        &[
            "aggregator",
            "serve",
            text(&dir),
            "--key",
            text(&key),
            "--policy",
            text(&key),
        ],
    );
    assert!(why.contains("rules name its witnesses"), "{why}");
}
