//! The keyboard through the ALSA sequencer, by part of its port's name.
//!
//! The sequencer does not notify its listeners when a keyboard is unplugged, so the port is checked
//! periodically.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant},
};

use midir::{Ignore, MidiInput, MidiInputConnection, MidiInputPort};

use super::source::{MidiError, MidiSource};

const CLIENT: &str = "etude";
/// Time between two checks. The system needs longer than this to find a keyboard that is plugged in
/// again.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Bytes that wait for the driver at most, several seconds of dense playing; later ones are lost.
const QUEUE_BYTES: usize = 8192;

/// A connection to one port of the sequencer.
pub(super) struct AlsaSource {
    spec: String,
    port: MidiInputPort,
    watcher: MidiInput,
    looked_at: Instant,
    queue: Arc<Mutex<VecDeque<u8>>>,
    _connection: MidiInputConnection<()>,
}

impl AlsaSource {
    /// Connects to the only port whose name contains `name`, ignoring case.
    pub(super) fn open(spec: &str, name: &str) -> Result<Self, MidiError> {
        let fail = |message: String| MidiError::Open { spec: spec.to_owned(), message };
        let no_sequencer = |_| fail("there is no ALSA sequencer: load it with `modprobe snd-seq`".to_owned());
        let watcher = MidiInput::new(CLIENT).map_err(no_sequencer)?;
        let mut input = MidiInput::new(CLIENT).map_err(no_sequencer)?;
        input.ignore(Ignore::None);

        let wanted = name.to_lowercase();
        let ports: Vec<(MidiInputPort, String)> = input
            .ports()
            .into_iter()
            .filter_map(|port| input.port_name(&port).ok().map(|name| (port, name)))
            .collect();
        let mut matching = ports.iter().filter(|(_, name)| name.to_lowercase().contains(&wanted));
        let (Some((port, _)), None) = (matching.next(), matching.next()) else {
            let names: Vec<&str> = ports.iter().map(|(_, name)| name.as_str()).collect();
            return Err(fail(format!(
                "not exactly one port has `{name}` in its name; plug the keyboard in, or choose one of: {}",
                names.join(", ")
            )));
        };

        let queue = Arc::new(Mutex::new(VecDeque::with_capacity(QUEUE_BYTES)));
        let filled = Arc::clone(&queue);
        let fill = move |_micros: u64, message: &[u8], (): &mut ()| {
            let mut queue = filled.lock().unwrap_or_else(PoisonError::into_inner);
            if queue.len() + message.len() <= QUEUE_BYTES {
                queue.extend(message);
            }
        };
        let connection =
            input.connect(port, "keyboard", fill, ()).map_err(|error| fail(format!("{error}; try again")))?;
        Ok(Self {
            spec: spec.to_owned(),
            port: port.clone(),
            watcher,
            looked_at: Instant::now(),
            queue,
            _connection: connection,
        })
    }
}

impl MidiSource for AlsaSource {
    fn receive(&mut self, out: &mut Vec<u8>) -> Result<(), MidiError> {
        out.extend(self.queue.lock().unwrap_or_else(PoisonError::into_inner).drain(..));
        if self.looked_at.elapsed() >= POLL_INTERVAL {
            self.looked_at = Instant::now();
            if !self.watcher.ports().contains(&self.port) {
                return Err(MidiError::Lost {
                    spec: self.spec.clone(),
                    message: "its port left the sequencer".to_owned(),
                });
            }
        }
        Ok(())
    }
}
