//! Listens for connections. Those that have come and were not taken yet wait in a queue of the system. While it is full, the system drops or
//! resets newcomers, so it has room for as many as a server has places.

use crate::connections::limits::MOST;
use std::io;
use std::net::SocketAddr;
use tokio::net::{TcpListener, TcpSocket};

/// Listens on this address, or on a free port of it. The queue has as many places as a server by default, unless the system allows fewer
/// (`net.core.somaxconn`; 4,096 where nobody has changed it).
///
/// # Errors
/// The system does not give the address, because another process listens on it or for another reason.
pub fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = match address {
        SocketAddr::V4(_) => TcpSocket::new_v4()?,
        SocketAddr::V6(_) => TcpSocket::new_v6()?,
    };
    // Connections of a server that has just ended do not keep the next one from listening.
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    socket.listen(MOST as u32)
}
