//! The two sockets between the driver and an arm, real or emulated.

use std::io::{self, ErrorKind};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::time::{Duration, Instant};

use crate::stream::{Outbox, read_available};

/// Ports of commands and of reports (ufactory_docs).
const PORTS: (u16, u16) = (502, 30003);
/// Longest time to connect, as in the official SDK.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);
/// Longest time until the first byte comes. An arm reports a hundred times a second; a firewall or
/// a proxy takes the connection, and nothing ever comes.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(3);
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
    /// Whatever is there, it is no arm: packets vanish, or nothing is ever said.
    #[error("nothing answers at {address}: check address, cable, firewall, and that the control box is on")]
    Silent {
        /// Where.
        address: String,
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

impl ArmLinkError {
    /// Whether no arm was ever reached, so that none was given power.
    pub fn is_unreached(&self) -> bool {
        !matches!(self, Self::Broken { .. })
    }
}

/// Whether something has ever come from an address.
#[derive(Debug)]
struct Listening {
    address: String,
    timeout: Duration,
    /// When it was listened to first; what is done before is no silence.
    since: Option<Instant>,
    heard: bool,
}

impl Listening {
    fn new(address: &str, timeout: Duration) -> Self {
        Self { address: address.to_string(), timeout, since: None, heard: false }
    }

    fn silent(&self) -> ArmLinkError {
        ArmLinkError::Silent { address: self.address.clone() }
    }

    /// The error of a connection that broke.
    fn broken(&self, doing: &'static str, source: io::Error) -> ArmLinkError {
        if self.heard { ArmLinkError::Broken { doing, source } } else { self.silent() }
    }

    /// Reads what has come from `stream`.
    fn read(
        &mut self,
        stream: &mut TcpStream,
        doing: &'static str,
        bytes: &mut Vec<u8>,
    ) -> Result<(), ArmLinkError> {
        let before = bytes.len();
        let read = read_available(stream, |piece| bytes.extend_from_slice(piece));
        self.heard |= bytes.len() > before;
        read.map_err(|source| self.broken(doing, source))?;
        let silence = self.since.get_or_insert_with(Instant::now).elapsed();
        if self.heard || silence <= self.timeout { Ok(()) } else { Err(self.silent()) }
    }
}

/// The socket for commands alone: enough to stop the arm and to ask whether it stands.
#[derive(Debug)]
pub struct ArmCommands {
    stream: TcpStream,
    outbox: Outbox,
    listening: Listening,
}

impl ArmCommands {
    /// Connects to the command port of `host`, written as for [`ArmConnection::open`].
    ///
    /// # Errors
    /// If the address cannot be read, or nothing answers there within a second.
    pub fn open(host: &str) -> Result<Self, ArmLinkError> {
        Self::open_with(host, CONNECT_TIMEOUT, SILENCE_TIMEOUT)
    }

    /// The same with other time limits, to connect and until the first byte.
    fn open_with(host: &str, connecting: Duration, silence: Duration) -> Result<Self, ArmLinkError> {
        let (name, (command, _)) = parse(host).ok_or_else(|| ArmLinkError::Address(host.into()))?;
        let listening = Listening::new(&format!("{name} port {command}"), silence);
        Ok(Self { stream: connect(name, command, connecting)?, outbox: Outbox::new(MAX_UNSENT), listening })
    }

    /// Appends what has come. Never waits.
    ///
    /// # Errors
    /// If the connection is gone.
    pub fn receive(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        self.listening.read(&mut self.stream, "reading replies", bytes)
    }

    /// Sends `bytes` after what still waits for the network. Never blocks: call it again with no
    /// bytes to send the rest.
    ///
    /// # Errors
    /// If the connection is gone, or the arm does not take commands any more.
    pub fn send(&mut self, bytes: &[u8]) -> Result<(), ArmLinkError> {
        let listening = &self.listening;
        let broken = |source| listening.broken("sending", source);
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
        Ok(Self { commands: ArmCommands::open(host)?, reports: connect(name, report, CONNECT_TIMEOUT)? })
    }

    /// Appends what has come from the report port. Never waits.
    ///
    /// # Errors
    /// If the connection is gone.
    pub fn receive_reports(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        self.commands.listening.read(&mut self.reports, "reading reports", bytes)
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

fn connect(host: &str, port: u16, timeout: Duration) -> Result<TcpStream, ArmLinkError> {
    let attempt = || {
        let mut last = io::Error::from(ErrorKind::NotFound);
        for address in (host, port).to_socket_addrs()? {
            match TcpStream::connect_timeout(&address, timeout) {
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
    attempt().map_err(|source| match source.kind() {
        // Nobody refuses: the packets vanish.
        ErrorKind::TimedOut | ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable => {
            ArmLinkError::Silent { address: format!("{host} port {port}") }
        }
        _ => ArmLinkError::Connect { host: host.into(), port, source },
    })
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;
    use std::net::TcpListener;

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

    const SHORT: Duration = Duration::from_millis(50);

    /// A connection to `listener` that waits for `silence` for the first byte.
    fn connected(listener: &TcpListener, silence: Duration) -> Result<ArmCommands, ArmLinkError> {
        let port = listener.local_addr().unwrap().port();
        ArmCommands::open_with(&format!("127.0.0.1:{port}:{port}"), SHORT, silence)
    }

    fn nothing_answers(error: &ArmLinkError) -> bool {
        let said = error.to_string();
        error.is_unreached()
            && said.starts_with("nothing answers at 127.0.0.1 port ")
            && said.contains("check address, cable, firewall")
    }

    /// A firewall that drops packets: the queue of a listener that accepts nobody is full.
    #[test]
    fn an_address_that_swallows_packets_is_one_where_nothing_answers() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut waiting = Vec::new();
        let refused = (0..10_000).find_map(|_| match connected(&listener, SHORT) {
            Ok(taken) => {
                waiting.push(taken);
                None
            }
            Err(error) => Some(error),
        });
        assert!(nothing_answers(&refused.unwrap()));
    }

    /// A proxy that takes every connection, and one that closes it.
    #[test]
    fn a_connection_from_which_nothing_ever_came_did_not_break() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut bytes = Vec::new();
        let mut failed = |commands: &mut ArmCommands| loop {
            if let Err(error) = commands.receive(&mut bytes) {
                return error;
            }
        };
        assert!(nothing_answers(&failed(&mut connected(&listener, SHORT).unwrap())));
        drop(listener.accept().unwrap());
        let patient = Duration::from_secs(3600);
        let mut closed = connected(&listener, patient).unwrap();
        drop(listener.accept().unwrap());
        assert!(nothing_answers(&failed(&mut closed)));
        // One that has spoken broke, and is never too silent.
        let mut spoken = connected(&listener, Duration::ZERO).unwrap();
        let mut arm = listener.accept().unwrap().0;
        arm.write_all(&[1]).unwrap();
        drop(arm);
        let broke = failed(&mut spoken);
        assert!(matches!(broke, ArmLinkError::Broken { .. }) && !broke.is_unreached(), "{broke}");
    }
}
