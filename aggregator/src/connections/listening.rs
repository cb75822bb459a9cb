//! Listens for connections. Those not yet accepted wait in a queue of the system. When it is full, newcomers are dropped or reset, so it
//! has as many places as the server.

use crate::connections::limits::MOST;
use std::io;
use std::net::SocketAddr;
use tokio::net::{TcpListener, TcpSocket};

/// Listens on this address, or on a free port of it. The system may shorten the queue (`net.core.somaxconn`, by default 4,096).
///
/// # Errors
/// The system refuses the address, for example because it is in use.
pub fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = match address {
        SocketAddr::V4(_) => TcpSocket::new_v4()?,
        SocketAddr::V6(_) => TcpSocket::new_v6()?,
    };
    // Connections of an ended server do not block the next one.
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    socket.listen(MOST as u32)
}
