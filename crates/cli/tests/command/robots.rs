//! `etude perform`, `robot`, `record` and `twin`: a robot that is not there, driven as a real one
//! is.

use std::io::{Read as _, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use etude_perform::Recording;
use serde_json::Value;

use crate::playing::check_elsewhere;
use crate::served_twin::Served;
use crate::{Sandbox, errors, wait_for};

const MODES: [&str; 3] = ["joint-mirroring", "hybrid", "real"];

#[test]
fn every_mode_plays_on_the_twin() {
    let sandbox = Sandbox::new();
    for mode in MODES {
        let args = format!("perform short.mid --scripted --mode {mode} --robot twin -o {mode} --json");
        let report = sandbox.json(&args);
        let f1 = |key: &str| report[key].as_f64().unwrap();
        assert!((f1("gap") - (1.0 - f1("robot_f1") / f1("sim_f1"))).abs() < 1e-12);
        assert!(f1("robot_f1") > 0.5 && f1("sim_f1") > 0.8, "{mode}: {report}");
        assert_eq!(
            (&report["mode"], &report["robot"], &report["twin_params"]),
            (&mode.into(), &"twin".into(), &"standard".into())
        );
        let run = &report["runs"][0];
        assert_eq!((&run["ending"], &run["timing"]["missed"]), (&"complete".into(), &0.into()));
        assert_eq!(run["alongside_f1"].is_null(), mode == "real");
        let recording = Recording::read(&sandbox.path(format!("{mode}/1/run-1.mcap"))).unwrap();
        let steps = run["steps"][0].as_u64().unwrap() as usize;
        assert!(recording.complete && recording.steps.len() == steps && recording.policy.len() == steps);
        assert!(recording.setpoints.len() > 10 * steps && recording.hand.len() > 16 * steps);
        assert!(recording.events.iter().any(|(_, note)| note.text == "following"));
        check_elsewhere("check_robot_recording.py", &[sandbox.path(mode).join("latest")]);
        check_elsewhere("check_midi.py", &[sandbox.path(mode).join("latest")]);
    }
}

/// The slowest link to the arm that a network in order may be.
#[test]
fn over_a_link_with_jitter_the_robot_plays_and_says_what_it_lacks() {
    let sandbox = Sandbox::new();
    let standard = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/twin-params/standard.toml");
    let standard = std::fs::read_to_string(standard).unwrap();
    let [usual, slow] = [[0.0005, 0.0005], [0.005, 0.01]]
        .map(|[delay, jitter]| format!("[links.arm]\ndelay_secs = {delay}\njitter_secs = {jitter}"));
    assert!(standard.contains(&usual));
    std::fs::write(sandbox.path("slow.toml"), standard.replace(&usual, &slow)).unwrap();
    let report = sandbox.json("perform twinkle --robot twin --twin-params slow.toml --json");
    assert!(report["robot_f1"].as_f64().unwrap() >= 0.9, "{report}");
    let warning = report["runs"][0]["warnings"][0].as_str().unwrap_or_default();
    assert!(
        warning.contains("50 targets a second instead of 200; connect its control box by cable"),
        "{report}"
    );
}

#[test]
fn each_robot_has_a_folder_of_its_own() {
    let sandbox = Sandbox::new();
    for (args, folder) in [
        ("", "short-scripted-real"),
        ("--twin-params worn", "short-scripted-real-worn"),
        ("--twin-params random:7", "short-scripted-real-random-7"),
        ("--fault joint-dead=5@30", "short-scripted-real-joint-dead-5-30"),
        ("--mode hybrid", "short-scripted-hybrid"),
    ] {
        let seen = std::fs::read_dir(sandbox.path("out")).map_or(0, Iterator::count);
        sandbox.ok(&format!("perform short.mid --scripted {args}"));
        assert!(sandbox.path("out").join(folder).join("latest/run-1.mcap").is_file(), "{folder}");
        assert_eq!(std::fs::read_dir(sandbox.path("out")).unwrap().count(), seen + 1, "{args}");
    }
}

#[test]
fn notes_are_on_time_by_a_run_before_or_by_the_proposed_lead() {
    let sandbox = Sandbox::new();
    let args = "perform twinkle --scripted --mode joint-mirroring --robot twin -o played";
    let is_on_time = |report: &serde_json::Value| {
        let late = report["runs"][0]["onset_error_median_secs"].as_f64().unwrap();
        let lead = report["latency_compensation_secs"].as_f64().unwrap();
        assert!(late.abs() <= 0.015 && lead > 0.08, "{late} s with a lead of {lead} s");
        lead
    };
    let output = sandbox.command(args).output().unwrap();
    assert!(errors(&output).contains("lag measurement (not counted)"), "{}", errors(&output));
    assert!(errors(&output).contains("; latency compensation: "), "{}", errors(&output));
    // The run that measures is none of those that are kept.
    assert!(sandbox.path("played/1/run-1.mcap").is_file() && !sandbox.path("played/1/run-2.mcap").exists());
    let report = std::fs::read(sandbox.path("played/1/report.json")).unwrap();
    is_on_time(&serde_json::from_slice(&report).unwrap());

    let said = sandbox.ok(&format!("{args} --set task.plan.latency_compensation_secs=0.025"));
    let lead = said
        .lines()
        .find_map(|line| line.split_once("--set task.plan.latency_compensation_secs="))
        .expect(&said)
        .1;
    let report = sandbox.json(&format!("{args} --set task.plan.latency_compensation_secs={lead} --json"));
    assert_eq!(is_on_time(&report), lead.parse::<f64>().unwrap());
}

#[test]
fn the_same_seed_gives_the_same_recording_byte_for_byte() {
    let sandbox = Sandbox::new();
    let play = |out: &str, more: &str| {
        sandbox.ok(&format!("perform short.mid --scripted --mode hybrid --robot twin -o {out} {more}"));
    };
    play("a", "--runs 2 --seed 5");
    play("b", "--seed 6");
    assert!(
        sandbox.bytes("a/1/run-2.mcap") == sandbox.bytes("b/1/run-1.mcap"),
        "seed 5, second run, is seed 6"
    );
    assert!(
        sandbox.bytes("a/1/run-1.mcap") != sandbox.bytes("a/1/run-2.mcap"),
        "runs differ as they do on a robot"
    );
    assert_eq!(sandbox.bytes("a/1/run-2.mid"), sandbox.bytes("b/1/run-1.mid"));
}

#[test]
fn mistakes_are_told_before_anything_moves() {
    let sandbox = Sandbox::new();
    std::fs::write(sandbox.path("bad.toml"), "name = \"x\"\n[limits]\nrail_velocity = -1.0\n").unwrap();
    std::fs::write(sandbox.path("lab.toml"), "name = \"lab\"\n").unwrap();
    let old = "schema = 1\nrig = \"lab\"\narm_serial = \"x\"\n[[points]]\npitch = 60\nrail_m = 0.0\n\
               position_mm = [485.0, 0.0, 170.0]\norientation_deg = [0.0, 0.0, 0.0]\nshown_unix_secs = 1\n";
    std::fs::write(sandbox.path("old.calibration.toml"), old).unwrap();
    std::fs::write(sandbox.path("old.toml"), "name = \"lab\"\n").unwrap();
    let has_box = "name = \"lab\"\n[arm]\nbox_mm = [[300, 300], [-400, 400], [100, 700]]\n";
    std::fs::write(sandbox.path("has_box.toml"), has_box).unwrap();
    for (args, said) in [
        ("perform short.mid --scripted --robot nowhere.toml", "nowhere.toml"),
        ("perform short.mid --scripted --robot bad.toml", "limits.rail_velocity is -1"),
        ("perform short.mid --scripted --robot lab.toml", "etude robot calibrate"),
        ("perform short.mid --scripted --robot old.toml", "days old"),
        ("perform short.mid --scripted --mode blind", "joint-mirroring, hybrid, real"),
        ("perform short.mid --scripted --twin-params no.toml", "random:SEED"),
        ("perform short.mid --scripted --twin-params random:seven", "whole number"),
        ("rehearse short.mid --robot twin --twin-params random:-7", "whole number"),
        ("record --robot twin --twin-params random: -o r.mcap", "whole number"),
        ("twin --twin-params random:1.5", "whole number"),
        ("perform short.mid --scripted --fault fire@1", "can-bus-off, can-silent"),
        ("perform short.mid --scripted --robot has_box.toml", "box_mm (highest x)"),
        ("twin --fault estop", "KIND[=VALUE]@SECS[+SECS]"),
        ("twin --fault hand-off@1+1", "has no duration"),
        ("robot stop --robot twin", "etude twin"),
        ("robot stop --robot lab.toml", "hardware stop"),
        ("record --robot twin -o r.mcap", "--secs"),
    ] {
        let output = sandbox.command(args).output().unwrap();
        let text = errors(&output) + &String::from_utf8_lossy(&output.stdout);
        assert!(
            !output.status.success() && text.contains(said) && !text.contains("panicked"),
            "{args}: {text}"
        );
    }
}

/// What is ordered happens, is told, and is in the recording.
#[test]
fn an_ordered_fault_cuts_the_performance_short() {
    let sandbox = Sandbox::new();
    for (number, fault, said) in
        [(1, "can-bus-off@10.5", "`ip link set can0 down`"), (2, "arm-error=31@10.5", "error 31")]
    {
        let play = format!("perform short.mid --scripted --robot twin --fault {fault} -o f");
        let output = sandbox.command(&play).output().unwrap();
        let text = errors(&output);
        assert!(
            !output.status.success() && text.contains("ended with a fault") && text.contains(said),
            "{text}"
        );
        let recording = Recording::read(&sandbox.path(format!("f/{number}/run-1.mcap"))).unwrap();
        let note = recording.events.iter().find(|(_, note)| note.kind == "fault");
        assert!(
            note.is_some_and(|(_, note)| note.text.contains(said) || note.text.contains("arm")),
            "{note:?}"
        );
    }
}

#[test]
fn a_robot_at_rest_can_be_recorded() {
    let sandbox = Sandbox::new();
    sandbox.ok("record --robot twin --secs 1 -o rest.mcap");
    let recording = Recording::read(&sandbox.path("rest.mcap")).unwrap();
    assert!(recording.complete && recording.hand.len() > 300 && recording.setpoints.len() >= 200);
}

/// The first run is complete; then the rig file names a robot that is not there.
#[test]
fn a_run_that_is_complete_has_a_report_if_the_next_one_cannot_begin() {
    let sandbox = Sandbox::new();
    let twin = Served::start(&sandbox);
    let rig = twin.rig.with_file_name("rig.toml");
    std::fs::copy(&twin.rig, &rig).unwrap();
    let lead = "--set task.plan.latency_compensation_secs=0.1";
    let mut play = sandbox.command(&format!(
        "perform short.mid --scripted --robot {} --home --runs 2 {lead} -o p",
        rig.display()
    ));
    let play = play.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    // Its guard has started, and has read the file.
    let recorded = || std::fs::metadata(sandbox.path("p/1/run-1.mcap")).map_or(0, |file| file.len());
    wait_for("the first run never began", || recorded() > 100_000);
    let text = std::fs::read_to_string(&rig).unwrap();
    std::fs::write(&rig, text.replace("bus:", "bus:/nowhere")).unwrap();
    let output = play.wait_with_output().unwrap();
    let said = errors(&output);
    assert!(output.status.code() == Some(1) && said.contains("run 2 was not played"), "{said}");
    let report: Value = serde_json::from_slice(&sandbox.bytes("p/1/report.json")).unwrap();
    assert_eq!(report["runs"].as_array().unwrap().len(), 1, "{report}");
    assert!(report["not_played"].is_string(), "{report}");
}

/// As a disk's quota or `ulimit -f` does it: the write fails, and the robot is let go.
#[test]
fn a_limit_on_the_size_of_files_does_not_kill_the_controller() {
    let sandbox = Sandbox::new();
    let mut command = Command::new("bash");
    let etude = assert_cmd::cargo::cargo_bin!("etude").display().to_string();
    let line = format!("ulimit -f 64; exec {etude} record --robot twin --secs 20 -o r.mcap");
    let output = command.current_dir(sandbox.path("")).args(["-c", &line]).output().unwrap();
    let said = errors(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("r.mcap") && said.contains("File too large"), "{said}");
    assert!(Recording::read(&sandbox.path("r.mcap")).is_ok(), "what was recorded is kept");
}

/// A keyboard that gives every note of the one at `source` this much higher, at `socket`.
fn shift_keyboard(source: PathBuf, socket: &Path, semitones: u8) {
    let listener = UnixListener::bind(socket).unwrap();
    let relay = move |mut client: UnixStream| {
        let mut keyboard = UnixStream::connect(&source).unwrap();
        let (mut byte, mut message) = ([0], Vec::new());
        while keyboard.read_exact(&mut byte).is_ok() {
            match byte[0] {
                0xF8.. => continue,
                status @ 0x80.. => message = vec![status],
                value => message.push(value),
            }
            if let [status, note, velocity] = message[..] {
                message.truncate(1);
                if client.write_all(&[status, note + semitones, velocity]).is_err() {
                    return;
                }
            }
        }
    };
    std::thread::spawn(move || {
        for client in listener.incoming() {
            let relay = relay.clone();
            std::thread::spawn(move || relay(client.unwrap()));
        }
    });
}

/// Beyond its highest key the driver knows it; within its keys the music shows it.
#[test]
fn a_shifted_keyboard_is_named() {
    for (semitones, said) in [(24, "shifted up by at least"), (12, "its notes are 12 semitones too high")] {
        let sandbox = Sandbox::new();
        let twin = Served::start(&sandbox);
        let text = std::fs::read_to_string(&twin.rig).unwrap();
        let source = text.split("midi = \"midi:").nth(1).unwrap().split('"').next().unwrap().to_string();
        let socket = sandbox.path("keyboard.sock");
        shift_keyboard(PathBuf::from(&source), &socket, semitones);
        let rig = text.replace(&format!("midi:{source}"), &format!("midi:{}", socket.display()));
        let shifted = twin.rig.with_file_name("shifted.toml");
        std::fs::write(&shifted, rig).unwrap();
        let lead = "--set task.plan.latency_compensation_secs=0.1";
        let robot = format!("--robot {} --home --mode hybrid", shifted.display());
        let play = format!("perform twinkle {robot} {lead} -o p");
        let output = sandbox.command(&play).output().unwrap();
        let printed = errors(&output);
        assert!(output.status.success() && printed.contains(said), "{semitones}: {printed}");
        assert!(printed.contains("press its octave - button"), "{semitones}: {printed}");
        let recording = Recording::read(&sandbox.path("p/1/run-1.mcap")).unwrap();
        let is_noted = recording.events.iter().any(|(_, note)| note.kind == "warning");
        assert!(is_noted || semitones == 12, "{:?}", recording.events);
    }
}

/// Before any device is opened. What is advised is typed as it is printed.
#[test]
fn a_song_that_is_too_fast_for_the_rigs_limits_is_named_before_the_start() {
    let sandbox = Sandbox::new();
    let rig = "name = \"slow\"\n[wires]\ncan = \"bus:nowhere\"\narm = \"127.0.0.1:1:1\"\n[limits]\nrail_velocity = 0.05\n";
    std::fs::write(sandbox.path("slow.toml"), rig).unwrap();
    let said = |line: &str| errors(&sandbox.command(line).output().unwrap());
    let warning = said("perform twinkle --robot slow.toml --home -o p");
    assert!(
        warning.contains("of 14 notes right (limits.rail_velocity = 0.05 (0.8 by default))"),
        "{warning}"
    );
    let advised: Vec<&str> = warning.split('`').filter_map(|part| part.strip_prefix("etude ")).collect();
    let [arrange, play] = advised[..2] else { panic!("{warning}") };
    assert!(arrange.contains("--stretch") && play.contains("--robot slow.toml --home"), "{warning}");
    sandbox.ok(arrange);
    let again = said(&format!("{play} -o q"));
    assert!(!again.contains("notes right") && again.contains("calibration"), "{again}");
}
