//! A loopback port, kept without a listener.

use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};

/// A port that no other process gets by chance until this is dropped. Servers can listen on it with `SO_REUSEADDR`. Otherwise, it refuses
/// connections.
pub struct OwnPort {
    address: SocketAddr,
    /// A connection keeps the system from assigning the port.
    _connection: [TcpStream; 2],
}

impl OwnPort {
    /// Takes a free port.
    pub fn take() -> Self {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        let client = TcpStream::connect(address).unwrap();
        let (server, _) = listener.accept().unwrap();
        Self {
            address,
            _connection: [client, server],
        }
    }

    /// The port's number.
    pub fn number(&self) -> u16 {
        self.address.port()
    }

    /// Host and port.
    pub fn address(&self) -> String {
        self.address.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::ErrorKind;

    #[test]
    fn one_server_after_the_other_listens_on_the_port() {
        let port = OwnPort::take();
        for _ in 0..3 {
            let refused = TcpStream::connect(port.address()).unwrap_err();
            assert_eq!(refused.kind(), ErrorKind::ConnectionRefused);
            let server = TcpListener::bind(port.address()).unwrap();
            let second = TcpListener::bind(port.address()).unwrap_err();
            assert_eq!(second.kind(), ErrorKind::AddrInUse);
            let client = TcpStream::connect(port.address()).unwrap();
            let (end, _) = server.accept().unwrap();
            drop((end, client));
        }
    }
}
