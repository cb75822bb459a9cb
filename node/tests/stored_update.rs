//! Updates that a node puts into the store of its aggregator: where they go, and where they do not.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread::{self, JoinHandle};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::task::spawn_blocking;
use zk0_node::client::stored_update::{StoreClient, StoredUpdateError};
use zk0_service::tls::local_authority::{LocalAuthority, CA, CERTIFICATE, KEY};
use zk0_service::tls::server_certificate::ServerCertificate;
use zk0_service::tls::service_address::ServiceAddress;

fn beside(aggregator: &str) -> StoreClient {
    StoreClient::beside(&ServiceAddress::from(aggregator.to_owned()))
}

/// A client whose aggregator is not encrypted.
fn plain() -> StoreClient {
    beside("http://zk0.example:1")
}

/// What a store got: the head, in small letters, and the body.
type Got = (String, Vec<u8>);

/// A store that takes one update, and then lets `answer` speak. Returns an address at which it takes the update.
fn store<T: Send + 'static>(
    answer: impl FnOnce(TcpStream) -> T + Send + 'static,
) -> (String, JoinHandle<(Got, T)>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let host = listener.local_addr().unwrap();
    let got = thread::spawn(move || {
        let (stream, _) = listener.accept().unwrap();
        let mut reader = BufReader::new(stream.try_clone().unwrap());
        let (mut head, mut length) = (String::new(), 0);
        loop {
            let mut line = String::new();
            reader.read_line(&mut line).unwrap();
            if line.trim().is_empty() {
                break;
            }
            let line = line.to_lowercase();
            if let Some(value) = line.strip_prefix("content-length:") {
                length = value.trim().parse().unwrap();
            }
            head += &line;
        }
        let mut body = vec![0; length];
        reader.read_exact(&mut body).unwrap();
        ((head, body), answer(stream))
    });
    (format!("http://{host}/a?signature=secret"), got)
}

/// Answers with a status.
fn reports(status: &str, more: &str) -> impl FnOnce(TcpStream) + Send + 'static {
    let answer =
        format!("HTTP/1.1 {status}\r\n{more}content-length: 0\r\nconnection: close\r\n\r\n");
    move |mut stream| stream.write_all(answer.as_bytes()).unwrap()
}

fn put(client: &StoreClient, address: &str) -> Result<(), StoredUpdateError> {
    client.put(address, b"update")
}

/// Why an update is not put at this address, which may not show the signature.
#[track_caller]
fn refused(client: &StoreClient, address: &str) -> String {
    let reported = put(client, address).unwrap_err().to_string();
    assert!(!reported.contains("secret"), "{reported}");
    reported
}

#[test]
fn the_whole_update_is_put_with_its_length() {
    let (address, got) = store(reports("200 OK", ""));
    let update: Vec<u8> = (0..300_000u32).map(|at| (at % 251) as u8).collect();
    plain().put(&address, &update).unwrap();
    let ((head, body), ()) = got.join().unwrap();
    assert!(
        head.starts_with("put /a?signature=secret http/1.1"),
        "{head}"
    );
    assert!(head.contains("x-ms-blob-type: blockblob"), "{head}");
    assert!(!head.contains("transfer-encoding"), "{head}");
    assert!(body[..] == update[..]);
}

/// Nobody waits until hundreds of megabytes are sent that the store does not take, and the node learns why.
#[test]
fn a_store_that_refuses_gets_nothing_of_the_update() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let host = listener.local_addr().unwrap();
    let got = thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let (mut got, mut some) = (Vec::new(), [0; 4096]);
        while !got.ends_with(b"\r\n\r\n") {
            let read = stream.read(&mut some).unwrap();
            got.extend(&some[..read]);
        }
        // This closes the connection, as stores do that are asked for too much.
        reports("503 Slow Down", "")(stream);
        String::from_utf8(got).unwrap().to_lowercase()
    });
    let update = vec![7; 32 << 20];
    let address = format!("http://{host}/a?signature=secret");
    let reported = plain().put(&address, &update).unwrap_err().to_string();
    assert!(
        reported.contains("does not take the update: 503"),
        "{reported}"
    );
    let head = got.join().unwrap();
    assert!(head.contains("content-length: 33554432"), "{head}");
    assert!(head.contains("expect: 100-continue"), "{head}");
}

/// An update is private until its round closes.
#[test]
fn an_update_does_not_leave_encryption() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.set_nonblocking(true).unwrap();
    let host = listener.local_addr().unwrap();
    let encrypted = beside("https://zk0.example:1");
    let reported = refused(&encrypted, &format!("http://{host}/a?signature=secret"));
    assert!(
        reported.contains(&format!("http://{host}, is not")),
        "{reported}"
    );
    assert!(listener.accept().is_err());
    // With encryption, anybody may be the store, and has to show a certificate.
    drop(listener);
    for client in [encrypted, plain()] {
        let reported = refused(&client, &format!("https://{host}/a?signature=secret"));
        assert!(reported.contains("cannot be reached"), "{reported}");
    }
}

/// The store's certificate has to be signed by an authority that the system trusts, or by the one of the aggregator's operator.
#[tokio::test(flavor = "multi_thread")]
async fn an_encrypted_store_shows_a_certificate_that_the_node_believes() {
    let dir = tempfile::tempdir().unwrap();
    let authority = LocalAuthority::new(&["127.0.0.1".to_owned()]).unwrap();
    authority.write(dir.path()).unwrap();
    let (certificate, key) = (dir.path().join(CERTIFICATE), dir.path().join(KEY));
    let certificate = ServerCertificate::load(&certificate, &key).unwrap();
    let acceptor = certificate.acceptor("http/1.1");
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let host = listener.local_addr().unwrap();
    let got = tokio::spawn(async move {
        loop {
            let (stream, _) = listener.accept().await.unwrap();
            // Who does not believe the certificate hangs up.
            let Ok(mut stream) = acceptor.accept(stream).await else {
                continue;
            };
            let (mut got, mut some) = (Vec::new(), [0; 4096]);
            while !got.ends_with(b"update") {
                match stream.read(&mut some).await {
                    Ok(read @ 1..) => got.extend(&some[..read]),
                    _ => break,
                }
            }
            if got.ends_with(b"update") {
                let answer = b"HTTP/1.1 200 OK\r\ncontent-length: 0\r\n\r\n";
                stream.write_all(answer).await.unwrap();
                stream.shutdown().await.unwrap();
                return got;
            }
        }
    });
    let aggregator = ServiceAddress::from("https://zk0.example:1".to_owned());
    let (without, with) = (
        StoreClient::beside(&aggregator),
        StoreClient::beside(&aggregator.with_ca(Some(dir.path().join(CA)))),
    );
    let address = format!("https://{host}/a?signature=secret");
    let reported = spawn_blocking(move || {
        let reported = refused(&without, &address);
        put(&with, &address).unwrap();
        reported
    });
    let reported = reported.await.unwrap();
    assert!(
        reported.contains("certificate is not signed by"),
        "{reported}"
    );
    assert!(got.await.unwrap().starts_with(b"PUT /a?signature=secret "));
}

#[test]
fn what_is_no_address_of_http_is_refused() {
    let long = format!("http://127.0.0.1:9/{}", "a".repeat(8 << 10));
    let none = [
        "",
        "s3.example",
        "/a",
        "ftp://127.0.0.1/a",
        "file:///etc/passwd",
    ];
    for address in none.into_iter().chain([&*long]) {
        let reported = put(&plain(), address);
        assert!(
            matches!(reported, Err(StoredUpdateError::NoAddress)),
            "{reported:?}"
        );
    }
}

#[test]
fn nobody_leads_the_node_elsewhere() {
    let elsewhere = TcpListener::bind("127.0.0.1:0").unwrap();
    elsewhere.set_nonblocking(true).unwrap();
    let location = format!("location: http://{}/b\r\n", elsewhere.local_addr().unwrap());
    for status in [
        "303 See Other",
        "307 Temporary Redirect",
        "308 Permanent Redirect",
    ] {
        let (address, got) = store(reports(status, &location));
        let reported = refused(&plain(), &address);
        assert!(reported.contains(&status[..3]), "{reported}");
        got.join().unwrap();
        let came = elsewhere.accept();
        assert!(came.is_err(), "{came:?}");
    }
}

#[test]
fn an_endless_answer_is_read_and_shown_in_part() {
    let endless = |mut stream: TcpStream| {
        let begin = "HTTP/1.1 403 Forbidden\r\nconnection: close\r\n\r\n<Code>AccessDenied</Code>\x1b[31m\n";
        stream.write_all(begin.as_bytes()).unwrap();
        let (some, mut sent) = ([b'x'; 64 << 10], 0);
        while sent < 1 << 30 && stream.write_all(&some).is_ok() {
            sent += some.len();
        }
        sent
    };
    let (address, got) = store(endless);
    let reported = refused(&plain(), &address);
    assert!(
        reported.contains("403 Forbidden <Code>AccessDenied</Code>"),
        "{reported}"
    );
    assert!(reported.len() < 400, "{reported}");
    assert!(!reported.contains(char::is_control), "{reported:?}");
    let (_, sent) = got.join().unwrap();
    assert!(sent < 32 << 20, "{sent} bytes");
}

#[test]
fn a_store_that_is_not_there_is_named() {
    let free = TcpListener::bind("127.0.0.1:0").unwrap();
    let host = free.local_addr().unwrap();
    drop(free);
    let reported = refused(&plain(), &format!("http://{host}/a?signature=secret"));
    let expected = format!("the store at {host} cannot be reached");
    assert!(reported.contains(&expected), "{reported}");
    let reported = refused(&plain(), &format!("http://user:secret@{host}/a"));
    assert!(reported.contains(&expected), "{reported}");
}
