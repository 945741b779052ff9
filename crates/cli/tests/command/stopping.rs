//! A robot in another process: however its controller ends, it is let go.

use std::io::{BufRead as _, BufReader, Write as _};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use etude_perform::Recording;
use etude_perform::session::Claim;
use etude_robot::priority::{Priority, Rank};
use etude_robot::rig_file::RigConfig;
use serde_json::Value;

use crate::processes::{self, children_of, with_arguments};
use crate::served_twin::{Served, is_safe};
use crate::{Sandbox, errors, wait_for};

#[test]
fn however_a_controller_ends_the_robot_is_let_go() {
    let sandbox = Sandbox::new();
    let twin = Served::start(&sandbox);
    let rig = twin.rig.display().to_string();
    let check = sandbox.json(&format!("robot check --robot {rig} --json"));
    assert_eq!((&check["rig"], &check["fault"]), (&"twin".into(), &Value::Null), "{check}");
    assert!(is_safe(twin.seen(&sandbox)), "after a check it is let go");

    // Far from the keyboard it refuses to play.
    let refused = sandbox.command(&format!("perform short.mid --scripted --robot {rig}")).output().unwrap();
    assert!(errors(&refused).contains("etude robot home"), "{}", errors(&refused));

    let home = || {
        let mut home = sandbox.command(&format!("robot home --robot {rig}"));
        let home = home.stderr(Stdio::piped()).spawn().unwrap();
        // Until it has claimed the rig, the monitor would read the keyboard.
        std::thread::sleep(Duration::from_secs(1));
        let on_its_way = Instant::now() + Duration::from_secs(20);
        while twin.seen(&sandbox) != (Value::Bool(true), 1.into()) {
            assert!(Instant::now() < on_its_way, "the arm never moved");
        }
        home
    };
    let lets_go = |what: &str, mut home: Child| {
        assert!(!home.wait().unwrap().success(), "{what}");
        std::thread::sleep(Duration::from_millis(600));
        assert!(is_safe(twin.seen(&sandbox)), "{what}");
    };

    let mut killed = home();
    killed.kill().unwrap();
    lets_go("killed", killed);

    let stopped = home();
    // A second one must not interfere, whatever file names the robot.
    let copy = sandbox.path("copy.toml");
    std::fs::copy(&twin.rig, &copy).unwrap();
    let copy = copy.display();
    let second = sandbox.command(&format!("robot check --robot {copy}")).output().unwrap();
    assert!(errors(&second).contains("another `etude`"), "{}", errors(&second));
    let stop = sandbox.json(&format!("robot stop --robot {copy} --json"));
    assert_eq!(stop["sure"], true, "{stop}");
    lets_go("stopped from another terminal", stopped);

    let interrupted = home();
    signal(&interrupted, "INT");
    lets_go("interrupted", interrupted);

    // A controller that hangs is as good as gone; when it wakes up it finds the arm stopped.
    let hung = home();
    signal(&hung, "STOP");
    std::thread::sleep(Duration::from_millis(1500));
    assert!(is_safe(twin.seen(&sandbox)), "hung");
    signal(&hung, "CONT");
    lets_go("woken", hung);

    // Without its guard the controller gives up, and also beside one that hangs.
    for (end, what) in [("KILL", "unguarded"), ("STOP", "beside a guard that hangs")] {
        let unguarded = home();
        let guards = with_arguments(&["robot", "guard", "--robot", &rig]);
        let guards: Vec<u32> =
            children_of(unguarded.id()).into_iter().filter(|id| guards.contains(id)).collect();
        assert_eq!(guards.len(), 1);
        processes::signal(guards[0], end);
        lets_go(what, unguarded);
        assert!(
            !with_arguments(&["robot", "guard", "--robot", &rig]).contains(&guards[0]),
            "{what}: it is left"
        );
    }

    // Both killed together: nobody sends a stop, and the arm stands where it was sent last. `robot
    // stop` then stops both.
    let mut both = home();
    let guards = with_arguments(&["robot", "guard", "--robot", &rig]);
    let guard = children_of(both.id()).into_iter().find(|id| guards.contains(id)).unwrap();
    // In one system call each, before one sees that the other is gone.
    processes::signal_all(&[both.id(), guard], "KILL");
    both.wait().unwrap();
    std::thread::sleep(Duration::from_millis(500));
    // Seen twice: the hand may hold its torque, but nothing moves.
    let places: Vec<Value> = (0..2).map(|_| twin.last_line(&sandbox)["arm"]["joints_rad"].clone()).collect();
    assert!(places[0].is_array() && places[0] == places[1], "{places:?}");
    let stop = sandbox.json(&format!("robot stop --robot {rig} --json"));
    assert_eq!(stop["sure"], true, "{stop}");
    assert!(is_safe(twin.seen(&sandbox)), "both killed, then stopped");

    // A file that cannot be written is told with the robot let go.
    std::fs::write(sandbox.path("full"), "no folder").unwrap();
    let failed = sandbox.command(&format!("perform short.mid --scripted --robot {rig} --home -o full"));
    let failed = { failed }.output().unwrap();
    assert!(errors(&failed).contains("cannot make the folder full"), "{}", errors(&failed));
    assert!(is_safe(twin.seen(&sandbox)), "a file that cannot be written");
}

fn signal(process: &Child, name: &str) {
    processes::signal(process.id(), name);
}

/// The controller ends with an error that names the stop.
fn names_the_stop(controller: Child) {
    let ended = controller.wait_with_output().unwrap();
    let said = errors(&ended);
    assert!(!ended.status.success() && said.contains("stopped by `etude robot stop`"), "{said}");
    assert!(!said.contains("did not confirm"), "{said}");
}

/// The request is made as soon as the controller has claimed the robot, long before it has loaded
/// what it plays.
#[test]
fn a_stop_is_not_lost_while_a_controller_starts() {
    let sandbox = Sandbox::new();
    let twin = Served::start(&sandbox);
    let rig = twin.rig.display();
    let mut perform = sandbox.command(&format!("perform ode-to-joy --scripted --robot {rig} --home -o p"));
    let perform = perform.stderr(Stdio::piped()).spawn().unwrap();
    let bus = claimed_bus(&twin.rig);
    wait_for("it never claimed the robot", || bus.exists());
    let stop = sandbox.json(&format!("robot stop --robot {rig} --json"));
    assert_eq!(stop["sure"], true, "{stop}");
    names_the_stop(perform);
    assert!(!sandbox.path("p/1/run-1.wav").exists() && is_safe(twin.seen(&sandbox)));
    // Afterwards it can be used again.
    assert_eq!(sandbox.json(&format!("robot check --robot {rig} --json"))["fault"], Value::Null);
    assert!(!bus.exists());
}

/// The hand's reply that its servo is off, and the arm's state, may come before the controller
/// looks for the request.
#[test]
fn a_stop_on_the_way_is_named_by_the_controller() {
    let sandbox = Sandbox::new();
    let twin = Served::start(&sandbox);
    let rig = twin.rig.display();
    let mut perform = sandbox.command(&format!("perform ode-to-joy --scripted --robot {rig} --home -o p"));
    let perform = perform.stderr(Stdio::piped()).spawn().unwrap();
    wait_for("it never recorded", || sandbox.path("p/1/run-1.mcap").exists());
    std::thread::sleep(Duration::from_secs(2));
    let stop = sandbox.json(&format!("robot stop --robot {rig} --json"));
    assert_eq!(stop["sure"], true, "{stop}");
    names_the_stop(perform);
    assert!(is_safe(twin.seen(&sandbox)));
}

/// The request is made after the controller has begun and before it has claimed the robot: it still
/// reads the rig's file, a pipe here.
#[test]
fn a_stop_is_not_lost_before_a_controller_has_claimed_the_robot() {
    let sandbox = Sandbox::new();
    let twin = Served::start(&sandbox);
    let slow = twin.rig.with_file_name("slow.toml");
    assert!(std::process::Command::new("mkfifo").arg(&slow).status().unwrap().success());
    let home = sandbox.command(&format!("robot home --robot {}", slow.display()));
    let home = { home }.stderr(Stdio::piped()).spawn().unwrap();
    // Opens when the other end reads.
    let mut pipe = std::fs::OpenOptions::new().write(true).open(&slow).unwrap();
    let stop = sandbox.json(&format!("robot stop --robot {} --json", twin.rig.display()));
    assert_eq!(stop["sure"], true, "{stop}");
    // What a guard would read again must be a file.
    std::fs::remove_file(&slow).unwrap();
    std::fs::copy(&twin.rig, &slow).unwrap();
    pipe.write_all(&std::fs::read(&twin.rig).unwrap()).unwrap();
    drop(pipe);
    names_the_stop(home);
    assert!(is_safe(twin.seen(&sandbox)));
}

#[test]
fn a_stop_is_not_lost_while_an_arm_is_made_ready_to_be_led() {
    let sandbox = Sandbox::new();
    let twin = Served::start(&sandbox);
    let rig = twin.rig.display();
    let mut leading = sandbox.command(&format!("robot calibrate --robot {rig} --at middle --by-hand"));
    let leading = leading.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let bus = claimed_bus(&twin.rig);
    wait_for("it never claimed the robot", || bus.exists());
    let stop = sandbox.json(&format!("robot stop --robot {rig} --json"));
    assert_eq!(stop["sure"], true, "{stop}");
    names_the_stop(leading);
    assert!(is_safe(twin.seen(&sandbox)));
}

/// The end of the input is not Enter: nothing is calibrated.
#[test]
fn a_terminal_that_goes_while_an_arm_is_led_calibrates_nothing() {
    let sandbox = Sandbox::new();
    let twin = Served::start(&sandbox);
    let calibration = RigConfig::load(&twin.rig).unwrap().calibration;
    let before = std::fs::read(&calibration).unwrap();
    let rig = twin.rig.display();
    let mut leading = sandbox.command(&format!("robot calibrate --robot {rig} --at middle --by-hand"));
    let output = leading.stdin(Stdio::null()).output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    assert_eq!(std::fs::read(&calibration).unwrap(), before);
    assert!(is_safe(twin.seen(&sandbox)));
}

/// A controller that hangs keeps its claim, and its guard must try again all the same until the
/// hand confirms.
#[test]
fn a_guard_tries_again_while_its_controller_hangs() {
    let sandbox = Sandbox::new();
    // The bus carries nothing at first, so the first tries cannot be confirmed.
    let twin = Served::with_fault(&sandbox, Some("can-silent@0+4"));
    let begun = Instant::now();
    let rig = RigConfig::load(&twin.rig).unwrap();
    // This process is the controller.
    let _claim = Claim::new(&rig.wires).unwrap();
    let (mut line, theirs) = UnixStream::pair().unwrap();
    let mut guard = sandbox.command(&format!("robot guard --robot {}", twin.rig.display()));
    guard.stdin(OwnedFd::from(theirs)).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = guard.spawn().unwrap();
    drop(guard);
    let mut ready = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut ready).unwrap();
    assert_eq!(ready.trim_end(), etude_perform::session::ready(&rig.wires));
    line.write_all(b".").unwrap();
    let ended = child.wait_with_output().unwrap();
    let said = errors(&ended);
    assert!(said.contains("guard: hand stopped") && said.contains("guard: arm stopped"), "{said}");
    assert!(begun.elapsed() > Duration::from_secs(1), "it was confirmed at once, which tests nothing");
}

#[test]
#[ignore = "takes half a minute: `make test-heavy`, which .ci/run calls"]
fn a_guard_that_cannot_stop_the_hand_ends_with_an_error() {
    let sandbox = Sandbox::new();
    let twin = Served::with_fault(&sandbox, Some("can-silent@0"));
    // The controller ends at once.
    let (_, theirs) = UnixStream::pair().unwrap();
    let mut guard = sandbox.command(&format!("robot guard --robot {}", twin.rig.display()));
    let guard = guard.stdin(OwnedFd::from(theirs)).output().unwrap();
    let said = errors(&guard);
    assert_eq!(guard.status.code(), Some(1), "{said}");
    assert!(said.contains("guard: arm stopped") && said.contains("switch off its power"), "{said}");
}

/// The file that claims the hand's bus of a rig.
fn claimed_bus(rig: &Path) -> PathBuf {
    let text = std::fs::read_to_string(rig).unwrap();
    let bus = text.split('"').find(|text| text.starts_with("bus:")).unwrap();
    let path = Path::new(bus.trim_start_matches("bus:")).canonicalize().unwrap();
    let name = format!("bus:{}", path.display()).replace('-', "--").replace('/', "-");
    Path::new("/tmp/etude").join(format!("{name}.lock"))
}

#[test]
fn a_hand_that_does_not_answer_is_not_called_stopped() {
    let sandbox = Sandbox::new();
    let twin = Served::with_fault(&sandbox, Some("can-silent@0"));
    let stop =
        sandbox.command(&format!("robot stop --robot {} --json", twin.rig.display())).output().unwrap();
    let told: Value = serde_json::from_slice(&stop.stdout).unwrap();
    assert_eq!((&told["arm"], &told["sure"]), (&"stopped".into(), &false.into()), "{told}");
    assert!(told["hand"].as_str().unwrap().contains("switch off its power"), "{told}");
    assert!(!stop.status.success() && errors(&stop).contains("hardware stop"), "{}", errors(&stop));
}

#[test]
fn a_small_turn_of_each_joint_finds_the_wrong_one() {
    let sandbox = Sandbox::new();
    let sound = sandbox.json("robot check --robot twin --joints --json");
    let joints = sound["joints"].as_array().unwrap();
    assert_eq!(joints.len(), 16);
    assert!(joints.iter().all(|joint| joint["problem"].is_null()), "{sound}");
    for (fault, joint, what) in
        [("joint-reversed=5@0", 5, "wrong direction"), ("joint-dead=9@0", 9, "did not turn")]
    {
        let twin = Served::with_fault(&sandbox, Some(fault));
        let check = sandbox.command(&format!("robot check --robot {} --joints --json", twin.rig.display()));
        let check = { check }.output().unwrap();
        let said = errors(&check);
        assert_eq!(check.status.code(), Some(1), "{said}");
        assert!(said.contains(&format!("joint {joint} ")) && said.contains(what), "{said}");
        let told: Value = serde_json::from_slice(&check.stdout).unwrap();
        assert!(told["joints"][joint]["problem"].as_str().unwrap().contains(what), "{told}");
        assert!(is_safe(twin.seen(&sandbox)), "{fault}");
    }
}

#[test]
fn an_arm_that_is_led_by_hand_is_not_left_free() {
    let sandbox = Sandbox::new();
    let twin = Served::start(&sandbox);
    let mut led =
        sandbox.command(&format!("robot calibrate --robot {} --at middle --by-hand", twin.rig.display()));
    let mut led = led.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    // Before that, `monitor` would claim the robot itself.
    let bus = claimed_bus(&twin.rig);
    wait_for("it never claimed the robot", || bus.exists());
    let (free, stopped) = (Value::from(2), Value::from(4));
    let mode = || {
        let last = twin.last_line(&sandbox);
        (last["arm"]["mode"].clone(), last["arm"]["state"].clone())
    };
    wait_for("the arm was never free", || mode().0 == free);
    if Priority::of_this_thread(Rank::Guard).is_ok() {
        let id = led.id();
        assert_eq!(processes::real_time_priority(id), Rank::Controller as i64, "it polls the arm");
    }
    led.kill().unwrap();
    led.wait().unwrap();
    wait_for("the arm was left free", || mode().1 == stopped);
}

/// What the operator must do now does not hide what happened.
#[test]
fn a_release_that_is_not_confirmed_does_not_hide_its_cause() {
    let sandbox = Sandbox::new();
    let play = "perform short.mid --scripted --robot twin --fault can-bus-off@10.5 -o f";
    let output = sandbox.command(play).output().unwrap();
    let said = errors(&output);
    assert!(says_both(&said), "{said}");
    assert!(sandbox.path("f/1/run-1.wav").exists() && sandbox.path("f/1/report.json").exists());

    // The bus is off all the time for a check and on the way home: the hand was never reached, so
    // that the cause is all there is to say. After 14 s, for a recording, it was.
    let twin = Served::with_fault(&sandbox, Some("can-bus-off@0"));
    let rig = twin.rig.display();
    for command in [format!("robot check --robot {rig}"), format!("robot home --robot {rig}")] {
        let output = sandbox.command(&command).output().unwrap();
        let said = errors(&output);
        let says_cause = said.contains("`ip link set can0 down`") && said.contains("use the hardware stop");
        assert!(output.status.code() == Some(1) && says_cause, "{command}: {said}");
        assert_eq!(twin.seen(&sandbox).1, 4, "{command}: the arm");
    }
    let record = sandbox.command("record --robot twin --twin-params off.toml --secs 20 -o r.mcap");
    std::fs::write(sandbox.path("off.toml"), "[[faults]]\nkind = \"can-bus-off\"\nat_secs = 14.0\n").unwrap();
    let output = { record }.output().unwrap();
    let said = errors(&output);
    assert!(output.status.code() == Some(1) && says_both(&said), "record: {said}");
    let recorded = Recording::read(&sandbox.path("r.mcap")).unwrap();
    assert!(recorded.complete, "it ends");
}

/// Why the robot was stopped, and what the operator must do because the hand has not confirmed it.
fn says_both(said: &str) -> bool {
    said.contains("`ip link set can0 down`") && said.contains("switch off its power")
}

#[test]
fn an_arm_without_a_box_does_not_move_and_a_box_is_proposed() {
    let sandbox = Sandbox::new();
    let twin = Served::start(&sandbox);
    let rig = twin.rig.display().to_string();
    let text = std::fs::read_to_string(&twin.rig).unwrap();
    let line = text.lines().find(|line| line.starts_with("box_mm = ")).unwrap();
    std::fs::write(&twin.rig, text.replace(line, "")).unwrap();
    let check = sandbox.json(&format!("robot check --robot {rig} --json"));
    let proposed = check["missing_box"].as_str().unwrap();
    let reply_secs = check["arm"]["replies_within_secs"].as_f64().unwrap();
    assert!(
        reply_secs > 0.0 && reply_secs < 0.1 && check["arm"]["targets_per_second"].is_number(),
        "{check}"
    );
    for verb in ["robot home", "perform short.mid --scripted --home"] {
        let refused = sandbox.command(&format!("{verb} --robot {rig}")).output().unwrap();
        assert!(!refused.status.success() && errors(&refused).contains(proposed), "{}", errors(&refused));
    }
    std::fs::write(&twin.rig, text.replace(line, proposed)).unwrap();
    let check = sandbox.json(&format!("robot check --robot {rig} --json"));
    assert_eq!((&check["missing_box"], &check["fault"]), (&Value::Null, &Value::Null));
}
