//! Serves the emulated arm on TCP sockets.
//!
//! It never listens on a Unix socket, because xArm-Python-SDK prefers such a socket to the real
//! robot. Only programs on this machine can connect.

use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::time::Duration;

use etude_robot::stream::{Outbox, read_available};

use super::emulator::ArmEmulator;
use super::state::{ConnectionId, ReportKind};

/// Clients of one port at most.
const MAX_CLIENTS: usize = 16;
/// A client that leaves more than this unread is cut off, bytes.
const MAX_UNREAD: usize = 1 << 16;

/// The ports of the controller; 0 takes any that is free.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ArmPorts {
    /// Commands.
    pub command: u16,
    /// Reports, in the order of [`ReportKind::ALL`].
    pub reports: [u16; 4],
}

impl ArmPorts {
    /// Any free ports.
    pub const FREE: Self = Self { command: 0, reports: [0; 4] };

    /// The port of one kind of report.
    pub fn of(&self, kind: ReportKind) -> u16 {
        self.reports[kind as usize]
    }
}

impl Default for ArmPorts {
    /// The robot's own ones (ufactory_docs). The first of them needs more than a user's rights.
    fn default() -> Self {
        Self { command: 502, reports: ReportKind::ALL.map(|kind| kind.numbers().0) }
    }
}

/// One port and its clients.
#[derive(Debug)]
struct Port<T> {
    listener: TcpListener,
    clients: Vec<Client<T>>,
}

#[derive(Debug)]
struct Client<T> {
    stream: TcpStream,
    outbox: Outbox,
    is_closed: bool,
    tag: T,
}

/// Serves one emulator to many clients.
#[derive(Debug)]
pub struct ArmServer {
    commands: Port<ConnectionId>,
    reports: Vec<Port<()>>,
}

impl ArmServer {
    /// Listens on five ports of this machine.
    ///
    /// # Errors
    /// If a port is taken or not allowed.
    pub fn bind(ports: ArmPorts) -> io::Result<Self> {
        let reports = ports.reports.into_iter().map(Port::bind).collect::<io::Result<_>>()?;
        Ok(Self { commands: Port::bind(ports.command)?, reports })
    }

    /// The ports that it listens on.
    ///
    /// # Errors
    /// If the system does not report them.
    pub fn ports(&self) -> io::Result<ArmPorts> {
        let number = |port: &TcpListener| port.local_addr().map(|address| address.port());
        let mut ports = ArmPorts { command: number(&self.commands.listener)?, ..ArmPorts::FREE };
        for (number_of, port) in ports.reports.iter_mut().zip(&self.reports) {
            *number_of = number(&port.listener)?;
        }
        Ok(ports)
    }

    /// In place of [`serve_once`](Self::serve_once) while connections are refused: closes all
    /// connections, and new ones at once.
    pub fn refuse_once(&mut self, now: Duration, emulator: &mut ArmEmulator) {
        emulator.advance(now);
        self.commands.hang_up(|id| emulator.disconnect(id));
        let mut unheard = Vec::new();
        for (kind, port) in ReportKind::ALL.into_iter().zip(&mut self.reports) {
            emulator.take_reports(kind, &mut unheard);
            port.hang_up(|()| {});
        }
    }

    /// Takes what clients have sent, lets the emulator's time pass until `now`, and sends what is
    /// due. Never waits; call it every millisecond or so.
    pub fn serve_once(&mut self, now: Duration, emulator: &mut ArmEmulator) {
        emulator.advance(now);
        let mut replies = Vec::new();
        for client in &mut self.commands.clients {
            let id = client.tag;
            client.read(|bytes| emulator.receive(now, id, bytes));
            replies.clear();
            emulator.take(id, &mut replies);
            client.push(&replies);
        }
        self.commands.flush(|id| emulator.disconnect(id));
        self.commands.accept(|| emulator.connect());
        let mut frames = Vec::new();
        for (kind, port) in ReportKind::ALL.into_iter().zip(&mut self.reports) {
            frames.clear();
            emulator.take_reports(kind, &mut frames);
            for client in &mut port.clients {
                client.read(|_| {});
                client.push(&frames);
            }
            port.flush(|()| {});
            port.accept(|| ());
        }
    }
}

impl<T> Client<T> {
    fn read(&mut self, take: impl FnMut(&[u8])) {
        self.is_closed |= read_available(&mut self.stream, take).is_err();
    }

    fn push(&mut self, bytes: &[u8]) {
        self.is_closed |= !self.outbox.push(bytes);
    }
}

impl<T: Copy> Port<T> {
    /// Closes all connections, and those that wait to be accepted.
    fn hang_up(&mut self, mut on_close: impl FnMut(T)) {
        self.clients.drain(..).for_each(|client| on_close(client.tag));
        while self.listener.accept().is_ok() {}
    }

    fn bind(number: u16) -> io::Result<Self> {
        let address = (Ipv4Addr::LOCALHOST, number);
        let explain = |error: io::Error| {
            let advice = match error.kind() {
                ErrorKind::PermissionDenied => "ports below 1024 need root; choose others",
                ErrorKind::AddrInUse => "another program has it; stop that or choose another",
                _ => "choose another",
            };
            io::Error::new(error.kind(), format!("cannot listen on port {number}: {error}; {advice}"))
        };
        let listener = TcpListener::bind(address).map_err(explain)?;
        listener.set_nonblocking(true).map_err(explain)?;
        Ok(Self { listener, clients: Vec::new() })
    }

    fn accept(&mut self, mut tag: impl FnMut() -> T) {
        while let Ok((stream, _)) = self.listener.accept() {
            let ready = stream.set_nonblocking(true).and_then(|()| stream.set_nodelay(true));
            if ready.is_ok() && self.clients.len() < MAX_CLIENTS {
                self.clients.push(Client {
                    stream,
                    outbox: Outbox::new(MAX_UNREAD),
                    is_closed: false,
                    tag: tag(),
                });
            }
        }
    }

    /// Sends what fits, and closes clients that are gone or do not read.
    fn flush(&mut self, mut on_close: impl FnMut(T)) {
        self.clients.retain_mut(|client| {
            client.is_closed |= client.outbox.flush(&mut client.stream).is_err();
            if client.is_closed {
                on_close(client.tag);
            }
            !client.is_closed
        });
    }
}
