//! The aggregator publishes its ledger as files and over HTTP. A reader who trusts nothing reads it back and replays it.

use std::fs;
use std::path::Path;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::{spawn_blocking, JoinHandle};
use zk0_aggregator::publish::http::{self, HttpLimits};
use zk0_aggregator::publish::log_server::LogServer;
use zk0_aggregator::Aggregator;
use zk0_aggregator::ConnectionLimits;
use zk0_audit::Auditor;
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::error::LedgerError;
use zk0_ledger::log::Ledger;
use zk0_ledger::published::export::{export, ExportError};
use zk0_ledger::published::mirror::{mirror, MirrorError};
use zk0_ledger::published::publication::Publication;
use zk0_ledger::published::reader::{PublishedError, PublishedLog};
use zk0_ledger::published::source::{FolderSource, LogSource};
use zk0_ledger::published::web::Web;
use zk0_ledger::replay::{replay, Verdict};
use zk0_protocol::tlog::verifier_key::{Role, VerifierKey};
use zk0_protocol::WitnessPolicy;
use zk0_testkit::aggregator::*;
use zk0_verifier::blob_digest;

fn key() -> VerifierKey {
    let genesis = genesis();
    VerifierKey::new(Role::Log, &genesis.name, &genesis.log_key).unwrap()
}

/// Makes a network whose first round is over and whose next round is open, with an update and a proof in it. Returns those two
/// blobs.
async fn busy() -> (Network, Digest, Digest) {
    let (network, first, second) = open_round().await;
    both_committed(&network, &first, &second).await;
    for node in [&first, &second] {
        let claim = node.claim(&network).await;
        node.submit(&network, claim, b"no proof").await.unwrap();
    }
    network.settle().await;
    let update = committed(&network, &first, 1, 3).await;
    committed(&network, &second, 1, 4).await;
    let claim = first.claim(&network).await;
    first.submit(&network, claim, b"not either").await.unwrap();
    (network, blob_digest(&update), blob_digest(b"not either"))
}

/// Records one more entry.
async fn grow(network: &Network) {
    let enrol =
        |aggregator: &mut Aggregator| aggregator.enrol(SigningNode::new(9).id(), "late".into());
    network.service().with(enrol).await.unwrap();
}

fn mirrored(source: &dyn LogSource, dir: &Path) -> Result<u64, MirrorError> {
    mirror(source, dir, None, None).map(|done| done.new_entries)
}

fn same_replay(ours: &Path, theirs: &Path) {
    let report = |dir| replay(dir, None, &mut Auditor::default());
    let (ours, theirs) = (report(ours), report(theirs));
    assert_eq!(ours.verdict, Verdict::Verified, "{:?}", ours.findings);
    // What the aggregator still holds back is not in the copy, and so it is not checked.
    assert_ne!(theirs.verdict, Verdict::Failed, "{:?}", theirs.findings);
    assert_eq!(theirs.root, ours.root);
    assert_eq!(theirs.state, ours.state);
    assert_eq!(
        (theirs.entries, theirs.checkpoints),
        (ours.entries, ours.checkpoints)
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn an_export_outlives_the_ledger() {
    let (network, update, proof) = busy().await;
    let dir = network.dir.path();
    let (out, copy) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    // The aggregator works on the ledger at the same time.
    let done = export(&Publication::open(dir, None).unwrap(), out.path()).unwrap();
    let folder = FolderSource::at(out.path());
    assert_eq!(mirrored(&folder, copy.path()).unwrap(), done.entries);
    same_replay(dir, copy.path());
    // The mirror holds all public blobs, and nothing of the open round.
    let blobs = Blobs::at(copy.path());
    assert!(blobs.contains(&blob_digest(b"no proof")));
    assert!(blobs.contains(&genesis().policy));
    for private in [update, proof] {
        assert!(Blobs::at(dir).contains(&private));
        assert!(!Blobs::at(out.path()).contains(&private));
        assert!(!blobs.contains(&private));
    }
    // A second export finds nothing new.
    let again = export(&Publication::open(dir, None).unwrap(), out.path()).unwrap();
    assert_eq!((again.tiles, again.blobs), (0, 0));
    assert_eq!(mirrored(&folder, copy.path()).unwrap(), 0);
    // The log grows, and the export and the mirror follow it.
    grow(&network).await;
    export(&Publication::open(dir, None).unwrap(), out.path()).unwrap();
    assert_eq!(mirrored(&folder, copy.path()).unwrap(), 1);
    same_replay(dir, copy.path());
    // A mirror can be mirrored from its folder.
    let third = tempfile::tempdir().unwrap();
    mirrored(&Publication::open(copy.path(), None).unwrap(), third.path()).unwrap();
    same_replay(dir, third.path());
}

/// Makes two ledgers of one log key. Their first entries are the same, and the later ones differ.
fn forked(ours: &Path, other: &Path) {
    let enrol = |ledger: &mut Ledger, node: u8| {
        let node = SigningNode::new(node).id();
        let name = "a node".into();
        let enrolled = zk0_protocol::entries::member::NodeEnrolled { node, name };
        ledger
            .append(START_MS, zk0_protocol::Body::NodeEnrolled(enrolled))
            .unwrap();
    };
    for (dir, last) in [(ours, 100), (other, 101)] {
        let (mut ledger, _) = Ledger::create(dir, genesis(), log_key(), START_MS).unwrap();
        (1..10).for_each(|node| enrol(&mut ledger, node));
        enrol(&mut ledger, last);
        (50..60).for_each(|node| enrol(&mut ledger, node));
    }
}

/// Makes a ledger that is shorter than those of [`forked`] and has another second entry.
fn older_fork(dir: &Path) {
    let (mut ledger, _) = Ledger::create(dir, genesis(), log_key(), START_MS).unwrap();
    let node = SigningNode::new(99).id();
    let name = "another node".into();
    let enrolled = zk0_protocol::entries::member::NodeEnrolled { node, name };
    ledger
        .append(START_MS, zk0_protocol::Body::NodeEnrolled(enrolled))
        .unwrap();
}

#[test]
fn a_mirror_follows_no_fork_and_no_older_log() {
    let dirs: Vec<_> = (0..4).map(|_| tempfile::tempdir().unwrap()).collect();
    let [ours, other, copy, out] = [0, 1, 2, 3].map(|at| dirs[at].path());
    forked(ours, other);
    let view = |dir| Publication::open(dir, None).unwrap();
    mirrored(&view(ours), copy).unwrap();
    export(&view(ours), out).unwrap();
    let before = (
        fs::read(copy.join("checkpoint")).unwrap(),
        fs::read(out.join("checkpoint")).unwrap(),
    );
    // The same key signs another history.
    let error = mirrored(&view(other), copy).unwrap_err();
    assert!(
        matches!(error, MirrorError::Published(PublishedError::Forked { .. })),
        "{error}"
    );
    let error = export(&view(other), out).unwrap_err();
    assert!(
        matches!(error, ExportError::Ledger(LedgerError::Forked { .. })),
        "{error}"
    );
    // The log is shorter than before.
    let short = tempfile::tempdir().unwrap();
    drop(Ledger::create(short.path(), genesis(), log_key(), START_MS).unwrap());
    let error = mirrored(&view(short.path()), copy).unwrap_err();
    assert!(
        matches!(
            error,
            MirrorError::Published(PublishedError::Behind {
                published: 1,
                known: 21
            })
        ),
        "{error}"
    );
    // An older part of the other history is a fork, and not just behind.
    let forked_early = tempfile::tempdir().unwrap();
    older_fork(forked_early.path());
    let error = mirrored(&view(forked_early.path()), copy).unwrap_err();
    assert!(
        matches!(
            error,
            MirrorError::Published(PublishedError::Forked { size: 2, .. })
        ),
        "{error}"
    );
    let error = export(&view(short.path()), out).unwrap_err();
    assert!(
        matches!(error, ExportError::Ledger(LedgerError::RolledBack { .. })),
        "{error}"
    );
    let after = (
        fs::read(copy.join("checkpoint")).unwrap(),
        fs::read(out.join("checkpoint")).unwrap(),
    );
    assert_eq!(before, after);
    assert_eq!(replay(copy, None, &mut ()).verdict, Verdict::Verified);
    // A second operator has another key under the same name.
    let theirs = tempfile::tempdir().unwrap();
    let secret = ed25519_dalek::SigningKey::from_bytes(&[43; 32]);
    let mut genesis = genesis();
    genesis.log_key = secret.verifying_key().to_bytes();
    drop(Ledger::create(theirs.path(), genesis, secret, START_MS).unwrap());
    assert!(mirrored(&view(theirs.path()), copy).is_err());
    let opened = PublishedLog::open(&view(theirs.path()), &key(), &WitnessPolicy::none()).map(drop);
    assert!(matches!(opened, Err(PublishedError::Checkpoint(_))));
    // A mirror is refused if its database is older than its own checkpoint.
    let text = fs::read(copy.join("checkpoint")).unwrap();
    let back = tempfile::tempdir().unwrap();
    mirrored(&view(short.path()), back.path()).unwrap();
    fs::write(back.path().join("checkpoint"), text).unwrap();
    let error = mirrored(&view(ours), back.path()).unwrap_err();
    assert!(
        matches!(error, MirrorError::Ledger(LedgerError::RolledBack { .. })),
        "{error}"
    );
}

/// A mirror refuses a log whose files are damaged or come from another history, and a blob that does not match its name.
#[test]
fn a_mirror_takes_nothing_on_trust() {
    let dirs: Vec<_> = (0..3).map(|_| tempfile::tempdir().unwrap()).collect();
    let [ours, other, out] = [0, 1, 2].map(|at| dirs[at].path());
    forked(ours, other);
    let files = [
        "tile/entries/000.p/21",
        "tile/0/000.p/21",
        "zk0/checkpoints/000.p/21",
    ];
    for file in files {
        for change in 0..3 {
            let out = out.join(format!("{change}-{}", file.replace('/', "-")));
            export(&Publication::open(ours, None).unwrap(), &out).unwrap();
            let path = out.join(file);
            let mut bytes = fs::read(&path).unwrap();
            match change {
                0 => *bytes.last_mut().unwrap() ^= 1,
                1 => bytes.truncate(bytes.len() / 2),
                _ => {
                    let theirs = out.with_extension("other");
                    export(&Publication::open(other, None).unwrap(), &theirs).unwrap();
                    bytes = fs::read(theirs.join(file)).unwrap();
                }
            }
            fs::write(&path, bytes).unwrap();
            let copy = tempfile::tempdir().unwrap();
            assert!(
                mirrored(&FolderSource::at(&out), copy.path()).is_err(),
                "{file} {change}"
            );
        }
    }
    // This blob does not match its name.
    let blob = POLICY.to_vec();
    Blobs::at(ours).put(&blob).unwrap();
    let out = out.join("blob");
    export(&Publication::open(ours, None).unwrap(), &out).unwrap();
    fs::write(Blobs::at(&out).path(&blob_digest(&blob)), b"something else").unwrap();
    let copy = tempfile::tempdir().unwrap();
    let error = mirrored(&FolderSource::at(&out), copy.path()).unwrap_err();
    assert!(error.to_string().contains("SHA-256"), "{error}");
    let wrong = Digest([9; 32]);
    let refused = mirror(&FolderSource::at(&out), copy.path(), None, Some(&wrong));
    assert!(refused.unwrap_err().to_string().contains("of network"));
}

#[test]
fn a_damaged_ledger_is_not_published() {
    let dirs: Vec<_> = (0..2).map(|_| tempfile::tempdir().unwrap()).collect();
    let [ours, other] = [0, 1].map(|at| dirs[at].path());
    forked(ours, other);
    Publication::open(ours, None).unwrap();
    // First the other history, then a shorter one, lies under this ledger's checkpoint.
    fs::rename(ours.join("log"), ours.join("away")).unwrap();
    fs::rename(other.join("log"), ours.join("log")).unwrap();
    let opened = Publication::open(ours, None)
        .map(drop)
        .unwrap_err()
        .to_string();
    assert!(opened.contains("the history was changed"), "{opened}");
    fs::remove_dir_all(ours.join("log")).unwrap();
    let short = tempfile::tempdir().unwrap();
    drop(Ledger::create(short.path(), genesis(), log_key(), START_MS).unwrap());
    fs::rename(short.path().join("log"), ours.join("log")).unwrap();
    let opened = Publication::open(ours, None)
        .map(drop)
        .unwrap_err()
        .to_string();
    assert!(opened.contains("rolled back"), "{opened}");
}

async fn served(dir: &Path, limits: HttpLimits) -> (String, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let router = LogServer::new(dir).router(limits);
    let task = tokio::spawn(http::serve(
        listener,
        router,
        limits,
        std::future::pending(),
    ));
    (address, task)
}

/// Sends bytes and reads the whole answer.
async fn raw(address: &str, request: &str) -> String {
    let mut stream = TcpStream::connect(address).await.unwrap();
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer).await;
    String::from_utf8_lossy(&answer).into_owned()
}

async fn get(address: &str, path: &str) -> String {
    raw(
        address,
        &format!("GET /{path} HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n"),
    )
    .await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_served_log_is_read_while_it_grows() {
    let (network, update, proof) = busy().await;
    let dir = network.dir.path().to_owned();
    let (address, _server) = served(&dir, HttpLimits::default()).await;
    let url = format!("http://{address}");
    let copy = tempfile::tempdir().unwrap();
    let to = copy.path().to_owned();
    let fetch = move |url: String, to: std::path::PathBuf| {
        spawn_blocking(move || mirrored(&Web::at(&url, None).unwrap(), &to).unwrap())
    };
    assert!(fetch(url.clone(), to.clone()).await.unwrap() > 10);
    same_replay(&dir, &to);
    grow(&network).await;
    assert_eq!(fetch(url.clone(), to.clone()).await.unwrap(), 1);
    same_replay(&dir, &to);
    // The server states how long clients may keep each file.
    let size = replay(&dir, None, &mut ()).entries;
    for (path, kind, cache) in [
        (
            "checkpoint".to_owned(),
            "text/plain; charset=utf-8",
            "no-cache",
        ),
        (
            "zk0/policy".to_owned(),
            "text/plain; charset=utf-8",
            "no-cache",
        ),
        (
            format!("tile/0/000.p/{size}"),
            "application/octet-stream",
            "immutable",
        ),
        (
            "tile/entries/000.p/3".to_owned(),
            "application/octet-stream",
            "immutable",
        ),
        (
            format!("blobs/sha256/{}", genesis().policy),
            "application/octet-stream",
            "immutable",
        ),
    ] {
        let answer = get(&address, &path).await;
        assert!(answer.starts_with("HTTP/1.1 200"), "{path}: {answer}");
        let head = answer.split("\r\n\r\n").next().unwrap();
        assert!(
            head.contains(&format!("content-type: {kind}")),
            "{path}: {head}"
        );
        assert!(
            head.contains("cache-control: ") && head.contains(cache),
            "{path}: {head}"
        );
        let length = format!("content-length: {}", answer.len() - head.len() - 4);
        assert!(
            !answer.is_ascii() || head.contains(&length),
            "{path}: {head}"
        );
    }
    // A verifier can use the policy that the server gives.
    let policy = get(&address, "zk0/policy").await;
    let policy = WitnessPolicy::parse(policy.split("\r\n\r\n").nth(1).unwrap()).unwrap();
    assert_eq!(policy.logs(), [key()]);
    // The server answers 404 for files that do not exist, do not exist yet, or are private.
    for path in [
        "",
        "checkpoint/",
        "log/CURRENT",
        "../checkpoint",
        &format!("tile/0/000.p/{}", size + 1),
        "tile/0/000",
        "tile/1/000.p/1",
        &format!("blobs/sha256/{update}"),
        &format!("blobs/sha256/{proof}"),
        &format!("blobs/sha256/{}", Digest([9; 32])),
    ] {
        let answer = get(&address, path).await;
        assert!(answer.starts_with("HTTP/1.1 404"), "{path}: {answer}");
    }
    let head = "HEAD /checkpoint HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n";
    let answer = raw(&address, head).await;
    assert!(
        answer.starts_with("HTTP/1.1 200") && answer.ends_with("\r\n\r\n"),
        "{answer}"
    );
    let delete = "DELETE /checkpoint HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n";
    assert!(raw(&address, delete).await.starts_with("HTTP/1.1 405"));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_of_files_has_limits() {
    let dir = tempfile::tempdir().unwrap();
    drop(Ledger::create(dir.path(), genesis(), log_key(), START_MS).unwrap());
    let limits = HttpLimits {
        connections: ConnectionLimits {
            most: 2,
            ..ConnectionLimits::default()
        },
        silence: Duration::from_millis(300),
        answer: Duration::from_millis(1500),
        body: 10,
    };
    let (address, _server) = served(dir.path(), limits).await;
    // The server refuses a head that is too long or never ends, and a body that is too long or never comes.
    let long = format!(
        "GET /checkpoint HTTP/1.1\r\nx: {}\r\n\r\n",
        "y".repeat(40_000)
    );
    assert!(!raw(&address, &long).await.starts_with("HTTP/1.1 200"));
    assert!(!raw(&address, "GET /checkpoint HTTP/1.1\r\n")
        .await
        .starts_with("HTTP/1.1 200"));
    let body = "POST /checkpoint HTTP/1.1\r\nhost: x\r\ncontent-length: 11\r\nconnection: close\r\n\r\n12345678901";
    assert!(raw(&address, body).await.starts_with("HTTP/1.1 413"));
    let silent = "POST /checkpoint HTTP/1.1\r\nhost: x\r\ncontent-length: 5\r\n\r\n";
    assert!(raw(&address, silent).await.starts_with("HTTP/1.1 408"));
    // Two clients take both places and send nothing. One of them makes room for a third.
    let _first = TcpStream::connect(&address).await.unwrap();
    let _second = TcpStream::connect(&address).await.unwrap();
    let answer = tokio::time::timeout(Duration::from_secs(10), get(&address, "checkpoint")).await;
    assert!(answer.unwrap().starts_with("HTTP/1.1 200"));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_not_http_or_not_a_log_is_said_so() {
    assert!(Web::at("ftp://x", None).is_err());
    let empty = tempfile::tempdir().unwrap();
    let (address, _server) = served(empty.path(), HttpLimits::default()).await;
    let answer = get(&address, "checkpoint").await;
    assert!(answer.starts_with("HTTP/1.1 500"), "{answer}");
    assert!(!answer.contains(empty.path().to_str().unwrap()), "{answer}");
    let copy = tempfile::tempdir().unwrap();
    let to = copy.path().join("mirror");
    let failed = spawn_blocking(move || {
        mirrored(&Web::at(&format!("http://{address}"), None).unwrap(), &to)
    });
    assert!(failed.await.unwrap().is_err());
    assert_eq!(files(copy.path()), 0);
}
