//! A robot whose devices are not there.

use std::net::TcpListener;

use crate::served_twin::Served;
use crate::{Sandbox, errors};

/// What was never reached was never given power: the guard, whose messages are in the output, has
/// nothing to stop.
#[test]
fn after_a_start_in_which_nothing_answers_the_guard_says_nothing() {
    for (fault, expected) in
        [(None, "nothing answers at 127.0.0.1"), (Some("can-silent@0"), "the hand does not answer")]
    {
        let sandbox = Sandbox::new();
        let twin = Served::with_fault(&sandbox, fault);
        // It takes every connection, and says nothing.
        let swallows = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = swallows.local_addr().unwrap().port();
        let text = std::fs::read_to_string(&twin.rig).unwrap();
        let arm = text.split("\narm = \"").nth(1).unwrap().split('"').next().unwrap();
        let rig = twin.rig.with_file_name("swallows.toml");
        std::fs::write(&rig, text.replace(arm, &format!("127.0.0.1:{port}:{port}"))).unwrap();
        let check = format!("robot check --robot {}", rig.display());
        let calibrate = format!("robot calibrate --robot {} --at middle", rig.display());
        let unreached = [(check, expected), (calibrate, "nothing answers at 127.0.0.1")];
        for (command, expected) in unreached {
            let output = sandbox.command(&command).output().unwrap();
            let said = errors(&output);
            assert!(output.status.code() == Some(1) && said.contains(expected), "{command}: {said}");
            for odd in ["guard:", "hardware stop", "emergency stop", "switch off"] {
                assert!(!said.contains(odd), "{command}: {said}");
            }
        }
    }
}
