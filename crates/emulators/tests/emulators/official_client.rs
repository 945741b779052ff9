//! The arm's emulator for UFACTORY's own client (`scripts/check_xarm.py` and
//! `scripts/check_xarm_calls.py`).

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::Duration;

use etude_emulators::ReportKind;

use super::served::ServedArm;

/// Environment variable that names a Python with xarm-python-sdk; `make test` sets it.
const PYTHON: &str = "ETUDE_PYTHON";

#[test]
fn the_official_client_takes_the_emulator_for_an_arm() {
    println!("{}", run_script("check_xarm.py"));
}

#[test]
fn the_official_clients_calls_are_answered() {
    println!("{}", run_script("check_xarm_calls.py"));
}

/// Runs a script of UFACTORY's client against an emulator, which must end well; what it prints.
fn run_script(name: &str) -> String {
    let Some(python) = std::env::var_os(PYTHON) else {
        // Not through a macro: the test harness would swallow it.
        let _ = writeln!(
            std::io::stderr(),
            "\n*** SKIPPED: the arm's emulator against UFACTORY's client. Set {PYTHON} to a Python with \
             xarm-python-sdk==1.18.4. ***\n"
        );
        return String::new();
    };
    let mut served = ServedArm::new();
    let ports = served.server.ports().unwrap();
    let script = format!("{}/../../scripts/{name}", env!("CARGO_MANIFEST_DIR"));
    let mut child = Command::new(&python)
        .arg(script)
        .arg(ports.command.to_string())
        .args([ReportKind::Normal, ReportKind::Rich, ReportKind::Real].map(|kind| ports.of(kind).to_string()))
        .stdout(Stdio::piped())
        .spawn()
        .unwrap_or_else(|error| panic!("{PYTHON}={python:?} does not run: {error}"));
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let (send, said) = mpsc::channel();
    let reader =
        std::thread::spawn(move || lines.map_while(Result::ok).for_each(|line| drop(send.send(line))));
    let mut transcript = String::new();
    let status = loop {
        let now = served.serve();
        while let Ok(line) = said.try_recv() {
            // The script orders an error, as a hand on the arm would.
            if let Some(code) = line.strip_prefix("inject ") {
                served.emulator.inject_error(code.parse().unwrap());
            }
            transcript += &line;
            transcript.push('\n');
        }
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if now > Duration::from_secs(120) {
            child.kill().unwrap();
        }
    };
    reader.join().unwrap();
    transcript.extend(said.try_iter());
    assert!(status.success(), "{status}\n{transcript}");
    transcript
}
