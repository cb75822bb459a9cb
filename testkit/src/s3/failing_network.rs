//! A network that fails on demand. It forwards one request per connection, and counts.

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

/// A request's fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Status 503.
    Unavailable,
    /// Breaks after this many bytes of the request.
    CutRequest(usize),
    /// Breaks after this many bytes of the answer.
    CutAnswer(usize),
    /// No answer.
    Silent,
    /// Delays the request.
    Late(Duration),
    /// The client hears at once that the request is done. The server gets it later, or never.
    Claimed(Option<Duration>),
}

/// Translates heads between different protocols.
#[derive(Clone, Copy)]
pub struct Translation {
    pub request: fn(&str) -> String,
    pub answer: fn(&str) -> String,
}

/// A network before a server.
pub struct FailingNetwork {
    port: u16,
    state: Arc<Mutex<FaultState>>,
}

#[derive(Default)]
struct FaultState {
    /// Next faults, by how requests begin: `PUT`, or `PUT /bucket/folder/`.
    next: VecDeque<(String, Option<Fault>)>,
    always: Option<Fault>,
    requests: Vec<String>,
}

impl FailingNetwork {
    /// Before the server at this port.
    pub fn in_front_of(server: u16, translation: Option<Translation>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let state = Arc::<Mutex<FaultState>>::default();
        let shared = state.clone();
        thread::spawn(move || {
            for client in listener.incoming().map_while(Result::ok) {
                let shared = shared.clone();
                thread::spawn(move || forward(client, (server, translation), &shared));
            }
        });
        Self { port, state }
    }

    /// The URL for clients.
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}", self.port)
    }

    /// Fails the next `times` requests that begin so: `PUT`, or `PUT /bucket/folder/`.
    pub fn fail_next(&self, method: &str, fault: Fault, times: usize) {
        let mut state = self.state.lock().unwrap();
        let faults = (0..times).map(|_| (method.to_owned(), Some(fault)));
        state.next.extend(faults);
    }

    /// First lets `times` requests pass.
    pub fn pass_next(&self, method: &str, times: usize) {
        let mut state = self.state.lock().unwrap();
        let passes = (0..times).map(|_| (method.to_owned(), None));
        state.next.extend(passes);
    }

    /// Fails all, and resets the count.
    pub fn fail_always(&self, fault: Fault) {
        let mut state = self.state.lock().unwrap();
        state.always = Some(fault);
        state.requests.clear();
    }

    /// Lets all pass.
    pub fn mend(&self) {
        let mut state = self.state.lock().unwrap();
        state.next.clear();
        state.always = None;
    }

    /// Such requests since the last call.
    pub fn counted(&self, begin: &str) -> usize {
        let mut state = self.state.lock().unwrap();
        let all = std::mem::take(&mut state.requests);
        let (counted, others): (Vec<_>, Vec<_>) =
            all.into_iter().partition(|one| one.starts_with(begin));
        state.requests = others;
        counted.len()
    }

    /// Whether all faults have happened.
    pub fn has_failed(&self) -> bool {
        self.state.lock().unwrap().next.is_empty()
    }
}

impl FaultState {
    fn fault(&mut self, head: &str) -> Option<Fault> {
        let place = self.next.iter().position(|(of, _)| head.starts_with(of));
        let next = place.and_then(|place| self.next.remove(place));
        next.map_or(self.always, |(_, fault)| fault)
    }
}

fn forward(
    mut client: TcpStream,
    (server, translation): (u16, Option<Translation>),
    state: &Mutex<FaultState>,
) {
    let Ok((head, body)) = head_and_body(&mut client) else {
        return;
    };
    let first_line = head.lines().next().unwrap_or_default().to_owned();
    let fault = {
        let mut state = state.lock().unwrap();
        state.requests.push(first_line);
        state.fault(&head)
    };
    let done = match fault {
        Some(Fault::Unavailable) => unavailable(client),
        Some(Fault::Silent) => {
            thread::sleep(Duration::from_secs(60));
            Ok(())
        }
        Some(Fault::Claimed(None)) => claimed(&mut client),
        fault => {
            if let Some(Fault::Claimed(Some(_))) = fault {
                // Drops the server's later answer.
                let _ = claimed(&mut client);
            }
            if let Some(Fault::Late(by) | Fault::Claimed(Some(by))) = fault {
                thread::sleep(by);
            }
            relay(client, (server, translation), &head, &body, fault)
        }
    };
    drop(done);
}

fn head_and_body(from: &mut TcpStream) -> io::Result<(String, Vec<u8>)> {
    let mut bytes = Vec::new();
    let mut some = [0; 4096];
    loop {
        if let Some(end) = bytes.windows(4).position(|four| four == b"\r\n\r\n") {
            let body = bytes.split_off(end + 4);
            bytes.truncate(end);
            let head = String::from_utf8(bytes);
            return head.map(|head| (head, body)).map_err(io::Error::other);
        }
        match from.read(&mut some)? {
            0 => return Err(ErrorKind::UnexpectedEof.into()),
            read => bytes.extend(&some[..read]),
        }
    }
}

fn claimed(client: &mut TcpStream) -> io::Result<()> {
    client.write_all(b"HTTP/1.1 200 OK\r\ncontent-length: 0\r\nconnection: close\r\n\r\n")?;
    client.shutdown(Shutdown::Write)
}

fn unavailable(mut client: TcpStream) -> io::Result<()> {
    client.write_all(
        b"HTTP/1.1 503 Service Unavailable\r\ncontent-length: 8\r\nconnection: close\r\n\r\nSlowDown",
    )?;
    client.shutdown(Shutdown::Write)?;
    // A client that still sends can read the answer first.
    client.set_read_timeout(Some(Duration::from_secs(2)))?;
    io::copy(&mut client, &mut io::sink())?;
    Ok(())
}

fn relay(
    mut client: TcpStream,
    (server, translation): (u16, Option<Translation>),
    head: &str,
    body: &[u8],
    fault: Option<Fault>,
) -> io::Result<()> {
    let head = translation.map_or(head.to_owned(), |of| (of.request)(head));
    let mut server = TcpStream::connect(("127.0.0.1", server))?;
    // Each request has its own connection, and its own fault.
    server.write_all(format!("{head}\r\nconnection: close\r\n\r\n").as_bytes())?;
    let (mut from, mut to) = (client.try_clone()?, server.try_clone()?);
    let of_request = match fault {
        Some(Fault::CutRequest(bytes)) => Some(bytes),
        _ => None,
    };
    let body = body.to_vec();
    let sending = thread::spawn(move || -> io::Result<()> {
        let mut left = of_request.unwrap_or(usize::MAX);
        let first = body.len().min(left);
        to.write_all(&body[..first])?;
        left -= first;
        copy_up_to(&mut from, &mut to, left)?;
        if of_request.is_some() {
            from.shutdown(Shutdown::Both)?;
            to.shutdown(Shutdown::Both)?;
        }
        Ok(())
    });
    let left = match fault {
        Some(Fault::CutAnswer(bytes)) => bytes,
        _ => usize::MAX,
    };
    let answered = match translation {
        Some(of) => head_and_body(&mut server).and_then(|(head, body)| {
            let head = (of.answer)(&head);
            client.write_all(format!("{head}\r\n\r\n").as_bytes())?;
            client.write_all(&body)
        }),
        None => Ok(()),
    };
    let answered = answered.and_then(|()| copy_up_to(&mut server, &mut client, left));
    let _ = client.shutdown(Shutdown::Both);
    let _ = server.shutdown(Shutdown::Both);
    let _ = sending.join();
    answered
}

fn copy_up_to(from: &mut TcpStream, to: &mut TcpStream, mut left: usize) -> io::Result<()> {
    let mut some = vec![0; 16 << 10];
    while left > 0 {
        let most = some.len().min(left);
        let read = match from.read(&mut some[..most]) {
            Ok(0) => break,
            Ok(read) => read,
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(error) => return Err(error),
        };
        to.write_all(&some[..read])?;
        left -= read;
    }
    Ok(())
}
