//! The two sockets between the driver and an arm, real or emulated.

use std::io::{self, ErrorKind};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::time::Duration;

use crate::stream::{Outbox, read_available};

/// Ports of commands and of reports (ufactory_docs).
const PORTS: (u16, u16) = (502, 30003);
/// Longest time to connect, as in the official SDK.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);
/// Commands that may wait for the network, in bytes. A servo target has 47: more than this has
/// waited for too long.
const MAX_UNSENT: usize = 4096;

/// The connection to the arm fails.
#[derive(Debug, thiserror::Error)]
pub enum ArmLinkError {
    /// The address cannot be read.
    #[error("\"{0}\" is not an arm's address; write a name or address, or name:command-port:report-port")]
    Address(String),
    /// No connection.
    #[error(
        "cannot connect to the arm at {host} port {port}: {source}; \
         check that the control box is on and that this computer is in its network"
    )]
    Connect {
        /// Where.
        host: String,
        /// Which of the two ports.
        port: u16,
        /// Why not.
        source: io::Error,
    },
    /// The connection broke.
    #[error(
        "the connection to the arm broke while {doing}: {source}; check cable and control box, then connect again"
    )]
    Broken {
        /// What was being done.
        doing: &'static str,
        /// How.
        source: io::Error,
    },
}

/// The socket for commands alone: enough to stop the arm and to ask whether it stands.
#[derive(Debug)]
pub struct ArmCommands {
    stream: TcpStream,
    outbox: Outbox,
}

impl ArmCommands {
    /// Connects to the command port of `host`, written as for [`ArmConnection::open`].
    ///
    /// # Errors
    /// If the address cannot be read, or nothing answers there within a second.
    pub fn open(host: &str) -> Result<Self, ArmLinkError> {
        let (name, (command, _)) = parse(host).ok_or_else(|| ArmLinkError::Address(host.into()))?;
        Ok(Self { stream: connect(name, command)?, outbox: Outbox::new(MAX_UNSENT) })
    }

    /// Appends what has come. Never waits.
    ///
    /// # Errors
    /// If the connection is gone.
    pub fn receive(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        let broken = |source| ArmLinkError::Broken { doing: "reading replies", source };
        read_available(&mut self.stream, |piece| bytes.extend_from_slice(piece)).map_err(broken)
    }

    /// Sends `bytes` after what still waits for the network. Never blocks: call it again with no
    /// bytes to send the rest.
    ///
    /// # Errors
    /// If the connection is gone, or the arm does not take commands any more.
    pub fn send(&mut self, bytes: &[u8]) -> Result<(), ArmLinkError> {
        let broken = |source| ArmLinkError::Broken { doing: "sending", source };
        self.outbox.flush(&mut self.stream).map_err(broken)?;
        if !self.outbox.push(bytes) {
            return Err(broken(ErrorKind::TimedOut.into()));
        }
        self.outbox.flush(&mut self.stream).map_err(broken)
    }
}

/// Both sockets.
#[derive(Debug)]
pub struct ArmConnection {
    /// The socket for commands.
    pub commands: ArmCommands,
    reports: TcpStream,
}

impl ArmConnection {
    /// Connects to `host`, or to `host:command-port:report-port`: for an emulator on other ports,
    /// or for the reports of port 30000.
    ///
    /// # Errors
    /// If the address cannot be read, or nothing answers there within a second.
    pub fn open(host: &str) -> Result<Self, ArmLinkError> {
        let (name, (_, report)) = parse(host).ok_or_else(|| ArmLinkError::Address(host.into()))?;
        Ok(Self { commands: ArmCommands::open(host)?, reports: connect(name, report)? })
    }

    /// Appends what has come from the report port. Never waits.
    ///
    /// # Errors
    /// If the connection is gone.
    pub fn receive_reports(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        let broken = |source| ArmLinkError::Broken { doing: "reading reports", source };
        read_available(&mut self.reports, |piece| bytes.extend_from_slice(piece)).map_err(broken)
    }
}

/// The arm at `host`, the same for every spelling of its address.
pub fn device(host: &str) -> String {
    let found = parse(host).and_then(|(name, (command, _))| (name, command).to_socket_addrs().ok()?.next());
    found.map_or_else(|| host.to_string(), |address| address.to_string())
}

/// Splits the ports off an address that has both.
fn parse(host: &str) -> Option<(&str, (u16, u16))> {
    let mut parts = host.split(':');
    let name = parts.next().filter(|name| !name.trim().is_empty())?;
    let ports = match (parts.next(), parts.next(), parts.next()) {
        (None, None, None) => PORTS,
        (Some(command), Some(report), None) => (command.parse().ok()?, report.parse().ok()?),
        _ => return None,
    };
    Some((name, ports))
}

fn connect(host: &str, port: u16) -> Result<TcpStream, ArmLinkError> {
    let attempt = || {
        let mut last = io::Error::from(ErrorKind::NotFound);
        for address in (host, port).to_socket_addrs()? {
            match TcpStream::connect_timeout(&address, CONNECT_TIMEOUT) {
                Ok(stream) => {
                    stream.set_nodelay(true)?;
                    stream.set_nonblocking(true)?;
                    return Ok(stream);
                }
                Err(error) => last = error,
            }
        }
        Err(last)
    };
    attempt().map_err(|source| ArmLinkError::Connect { host: host.into(), port, source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read() {
        assert_eq!(parse("192.168.1.111"), Some(("192.168.1.111", PORTS)));
        assert_eq!(parse("127.0.0.1:5020:5003"), Some(("127.0.0.1", (5020, 5003))));
        for odd in ["", ":1:2", "arm:1", "arm:1:2:3", "arm:1:seventy"] {
            assert_eq!(parse(odd), None, "{odd}");
        }
        assert!(matches!(ArmConnection::open("arm:1"), Err(ArmLinkError::Address(_))));
    }
}
