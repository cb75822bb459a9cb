//! Connections that state nothing, too many of them, and a process that has no file left for another one.

use super::{bounded_service, patient_service, service, soon, SOON};
use std::fs::File;
use std::io::{Read, Seek};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::{sleep, timeout};
use zk0_prover::service::upload::UploadTimeout;

/// An empty frame of settings that acknowledges those of a client.
const ACKNOWLEDGED: &[u8] = b"\0\0\0\x04\x01\0\0\0\0";

/// What a client of HTTP/2 sends first, with settings that change nothing.
const BEGIN: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0";

fn impatient(silence: Duration) -> UploadTimeout {
    UploadTimeout {
        silence,
        ..UploadTimeout::default()
    }
}

async fn connected(address: &str) -> TcpStream {
    let address = address.trim_start_matches("http://");
    TcpStream::connect(address).await.unwrap()
}

/// Waits until the service has closed the connection. Answers no question of the service.
async fn is_cut(mut connection: TcpStream) {
    let mut heard = vec![];
    let end = connection.read_to_end(&mut heard);
    let end = timeout(SOON, end).await;
    // The service may also reset it.
    let _ = end.expect("the connection stays open");
}

#[tokio::test]
async fn who_connects_and_says_nothing_is_cut() {
    let service = patient_service(4, 1, impatient(Duration::from_secs(2))).await;
    let mut silent = vec![];
    for reported in [&BEGIN[..0], &BEGIN[..3], &BEGIN[..23]] {
        let mut connection = connected(&service.address).await;
        connection.write_all(reported).await.unwrap();
        silent.push(connection);
    }
    for connection in silent {
        is_cut(connection).await;
    }
    service.prove("claim").await.unwrap();
}

/// The client and the service are on one thread. It is busy until the time is over.
#[tokio::test]
async fn who_began_in_time_is_not_cut_by_a_service_that_looks_late() {
    let silence = Duration::from_secs(1);
    let service = patient_service(4, 1, impatient(silence)).await;
    let mut connection = connected(&service.address).await;
    // The service speaks, and waits for the first bytes now.
    let mut heard = vec![];
    connection.read_buf(&mut heard).await.unwrap();
    connection.write_all(BEGIN).await.unwrap();
    std::thread::sleep(silence + Duration::from_millis(100));
    let answered = async {
        while !heard
            .windows(ACKNOWLEDGED.len())
            .any(|at| at == ACKNOWLEDGED)
        {
            let read = connection.read_buf(&mut heard).await;
            assert!(matches!(read, Ok(1..)), "it is cut: {read:?}");
        }
    };
    let answered = timeout(SOON, answered).await;
    answered.expect("the service answers");
}

#[tokio::test]
async fn a_client_that_is_not_there_any_more_is_cut() {
    let service = patient_service(4, 0, impatient(Duration::from_millis(400))).await;
    let mut connection = connected(&service.address).await;
    connection.write_all(BEGIN).await.unwrap();
    is_cut(connection).await;
}

#[tokio::test]
async fn connections_beyond_the_bound_wait_until_one_ends() {
    let service = bounded_service(4, 1, |service| service.with_connections(2)).await;
    let silent = [
        connected(&service.address).await,
        connected(&service.address).await,
    ];
    let proof = service.prove("claim");
    let mut proof = std::pin::pin!(proof);
    let early = timeout(Duration::from_secs(1), &mut proof).await;
    assert!(early.is_err(), "a third connection is served");
    drop(silent);
    soon(proof).await;
}

/// Runs in a process of its own, which may open few files.
#[test]
fn a_service_that_may_open_no_file_waits_until_it_may() {
    let name = "service::connections::a_service_that_may_open_no_file_waits_until_it_may";
    if !super::one_prover::is_limited("ulimit -n 64", name) {
        return;
    }
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let mut usage = File::open("/proc/self/stat").unwrap();
        let service = service(4, 1).await;
        let mut files: Vec<_> = std::iter::from_fn(|| File::open("/dev/null").ok()).collect();
        // One file is left for the client's side of a connection, and none for the service's.
        files.pop();
        let before = ticks(&mut usage);
        let _connection = connected(&service.address).await;
        sleep(Duration::from_millis(500)).await;
        let spent = ticks(&mut usage) - before;
        assert!(spent < 10, "{spent} of 50 ticks were spent on nothing");
        drop(files);
        service.prove("claim").await.unwrap();
    });
}

/// The processor time that this process has used, in hundredths of a second.
fn ticks(usage: &mut File) -> u64 {
    let mut line = String::new();
    usage.rewind().unwrap();
    usage.read_to_string(&mut line).unwrap();
    let (_, fields) = line.rsplit_once(") ").unwrap();
    let fields: Vec<_> = fields.split(' ').collect();
    // Fields 14 and 15 of proc_pid_stat(5). The third one is the first here.
    [fields[11], fields[12]]
        .map(|field| field.parse::<u64>().unwrap())
        .iter()
        .sum()
}
