//! Connections without HTTP, from any loopback address.

use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpSocket, TcpStream};
use tokio::time::timeout;

/// The beginning of HTTP/2, and an empty frame of settings.
pub const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0";

/// Connects from 127.0.`network`.`host`.
pub async fn from([network, host]: [u8; 2], url: &str) -> TcpStream {
    let socket = TcpSocket::new_v4().unwrap();
    socket.bind(([127, 0, network, host], 0).into()).unwrap();
    let address = url.strip_prefix("http://").unwrap();
    socket.connect(address.parse().unwrap()).await.unwrap()
}

/// [`from`] with HTTP/2, until the server answers or closes.
pub async fn speaking(address: [u8; 2], url: &str) -> TcpStream {
    let mut stream = from(address, url).await;
    stream.write_all(PREFACE).await.unwrap();
    let _ = stream.read_u8().await;
    stream
}

/// Whether it closes in this time.
pub async fn closes(stream: &mut TcpStream, within: Duration) -> bool {
    let mut buffer = [0; 1024];
    timeout(within, async {
        while !matches!(stream.read(&mut buffer).await, Ok(0) | Err(_)) {}
    })
    .await
    .is_ok()
}

/// Whether it is closed, or closes at once.
pub async fn closed(stream: &mut TcpStream) -> bool {
    closes(stream, Duration::from_millis(200)).await
}

/// Begins a message of 4 MiB. The headers are in HPACK's literal form.
pub async fn begin_large_message(stream: &mut TcpStream) {
    let mut headers = Vec::new();
    for (name, value) in [
        (":method", "POST"),
        (":scheme", "http"),
        (":path", "/zk0.v1.Federation/Record"),
        (":authority", "x"),
        ("content-type", "application/grpc"),
        ("te", "trailers"),
    ] {
        headers.push(0);
        for text in [name, value] {
            headers.push(text.len() as u8);
            headers.extend_from_slice(text.as_bytes());
        }
    }
    let frame = |kind: u8, flags: u8, payload: &[u8]| {
        let length = (payload.len() as u32).to_be_bytes();
        [&length[1..], &[kind, flags, 0, 0, 0, 1], payload].concat()
    };
    let prefix = [&[0][..], &(4u32 << 20).to_be_bytes()].concat();
    let begun = [
        PREFACE.to_vec(),
        frame(1, 4, &headers),
        frame(0, 0, &prefix),
    ];
    stream.write_all(&begun.concat()).await.unwrap();
}
