//! `etude serve`: uploaded songs, jobs, and the end of the server.

use std::io::Write as _;
use std::net::TcpStream;

use etude_music::Song;
use serde_json::{Value, json};

use crate::browser::{all_pass, browser_tests};
use crate::processes::{children_of, with_arguments};
use crate::server::{Server, with_song};
use crate::songs::write_slow;
use crate::{TINY, errors, root, wait_for};

#[test]
fn a_dropped_file_is_bounded_and_must_be_midi() {
    let sandbox = with_song();
    let server = Server::start(&sandbox);
    let song = sandbox.bytes("songs/short.mid");
    let origin = format!("http://{}", server.host);
    let head = format!(
        "POST /{}/songs?name=big.mid HTTP/1.1\r\nHost: {}\r\nOrigin: {origin}\r\nConnection: close\r\n",
        server.token, server.host
    );
    // Refused before it is sent, and while it is sent without a length.
    let announced = server.raw(format!("{head}Content-Length: 1048577\r\n\r\n").as_bytes());
    assert_eq!(announced.status, 413);
    assert!(announced.why().starts_with("it is larger than 1 MiB; "), "{}", announced.why());
    let chunk = [b"80000\r\n".as_slice(), &vec![0; 0x80000], b"\r\n"].concat();
    let chunked =
        [format!("{head}Transfer-Encoding: chunked\r\n\r\n").into_bytes(), chunk.repeat(3)].concat();
    assert_eq!(server.raw(&chunked).status, 413);
    for (name, bytes) in
        [("text.mid", b"no music".as_slice()), ("none.mid", b""), ("half.mid", &song[..song.len() / 2])]
    {
        let response = server.post(&format!("songs?name={name}"), bytes);
        assert_eq!(response.status, 422, "{name}");
        assert!(response.why().starts_with(&format!("{name} cannot be used: ")), "{}", response.why());
    }
    assert_eq!(server.post("songs", &song).status, 400);
    assert!(!sandbox.path("out").exists(), "nothing was kept");

    let kept =
        |name: &str, bytes: &[u8]| server.post(&format!("songs?name={name}"), bytes).json()["song"].clone();
    assert_eq!(kept("..%2F..%2FF%C3%BCr%20Elise.mid", &song), "out/songs/Für Elise.mid");
    assert_eq!(sandbox.bytes("out/songs/Für Elise.mid"), song);
    // The same again is the same; another one, and one that is called like a built-in song, get
    // names of their own.
    sandbox.write_song("other.mid", [64, 62, 60]);
    let other = sandbox.bytes("other.mid");
    assert_eq!(kept("F%C3%BCr%20Elise.mid", &song), "out/songs/Für Elise.mid");
    assert_eq!(kept("F%C3%BCr%20Elise.mid", &other), "out/songs/Für Elise 2.mid");
    assert_eq!(kept("short.mid", &song), "songs/short.mid");
    assert_eq!(kept("twinkle.mid", &song), "out/songs/twinkle.mid");
    assert_eq!(kept("-o.mid", &other), "out/songs/o.mid");
    // Who has learned a song of that name has not learned this one.
    let plays = |song: &str| {
        let about = server.get(&format!("song?name={song}")).json();
        assert_eq!(about["problem"], Value::Null, "{about}");
        let file = about["policy"].as_str().unwrap().rsplit('/').next().unwrap().to_string();
        (file, about["zero_shot"].as_bool().unwrap())
    };
    assert_eq!(plays("out/songs/twinkle.mid"), ("sight-reader.safetensors".to_string(), true));
    assert_eq!(plays("twinkle"), ("twinkle.safetensors".to_string(), false));
    assert_eq!(server.get("song?name=other.mid").status, 404);
}

#[test]
fn a_song_that_the_keyboard_has_not_is_transposed() {
    let sandbox = with_song();
    sandbox.write_song("songs/low.mid", [24, 26, 28]);
    let server = Server::start(&sandbox);
    let about = server.get("song?name=songs/low.mid").json();
    assert!(about["problem"].as_str().unwrap().contains("outside the keyboard"), "{about}");
    assert!(about["transpositions"].as_array().unwrap().contains(&12.into()), "{about}");
    let play = server.begin(&json!({ "verb": "play", "song": "songs/low.mid", "player": "scripted" }));
    let failed = server.ended(play);
    assert_eq!(failed["state"], "failed");
    assert!(failed["log"][0].as_str().unwrap().contains("outside the keyboard"), "{failed}");
    assert!(!failed["log"].to_string().contains("ended with"), "{failed}");
    let made =
        server.does(&json!({ "verb": "arrange", "song": "songs/low.mid", "changes": { "transpose": 12 } }));
    assert_eq!(made["output"], "out/songs/low +12.mid");
    assert_eq!(server.get("song?name=out/songs/low%20%2B12.mid").json()["problem"], Value::Null);
    // Nothing would be left of it.
    assert_eq!((&about["outside"], &about["notes"]), (&3.into(), &3.into()), "{about}");
    // Slower, and the upper voice alone.
    let request = json!({ "verb": "arrange", "song": "out/songs/low +12.mid", "changes": { "stretch": 1.5, "melody": true } });
    let made = server.does(&request);
    assert_eq!(made["output"], "out/songs/low +12 x1.5 melody.mid");
    let slower = Song::load(sandbox.path("out/songs/low +12 x1.5 melody.mid")).unwrap();
    let before = Song::load(sandbox.path("out/songs/low +12.mid")).unwrap();
    assert!((slower.duration_secs() / before.duration_secs() - 1.5).abs() < 0.02);
}

/// The same notes as the verb leaves out.
#[test]
fn notes_that_the_keyboard_has_not_are_left_out() {
    let sandbox = with_song();
    sandbox.write_song("songs/wide.mid", [24, 60, 96]);
    let server = Server::start(&sandbox);
    let about = server.get("song?name=songs/wide.mid").json();
    assert_eq!((&about["outside"], &about["notes"]), (&2.into(), &3.into()), "{about}");
    assert_eq!(about["transpositions"], json!([]));
    let request = json!({ "verb": "arrange", "song": "songs/wide.mid", "changes": { "within_range": true } });
    let made = server.does(&request);
    assert_eq!(made["output"], "out/songs/wide within range.mid");
    sandbox.ok("songs arrange songs/wide.mid --within-range -o same.mid");
    assert_eq!(sandbox.bytes("out/songs/wide within range.mid"), sandbox.bytes("same.mid"));
    assert_eq!(server.does(&request)["output"], made["output"]);
}

#[test]
fn songs_whose_names_have_the_same_short_form_are_told_apart() {
    let sandbox = with_song();
    sandbox.write_song("songs/Bach 1.mid", [60, 62, 64]);
    sandbox.write_song("songs/Bach_1.mid", [64, 62, 60]);
    sandbox.write_song("songs/песня.mid", [60, 62, 64]);
    let server = Server::start(&sandbox);
    let is_ready = |name: &str| server.get(&format!("song?name=songs/{name}")).json()["is_ready"].clone();
    server.does(&json!({ "verb": "show", "song": "songs/Bach 1.mid" }));
    assert_eq!((is_ready("Bach%201.mid"), is_ready("Bach_1.mid")), (true.into(), false.into()));
    let shown = server.does(&json!({ "verb": "show", "song": "songs/песня.mid" }));
    assert_eq!(server.get(&format!("files/{}", shown["output"].as_str().unwrap())).json()["title"], "песня");
    // A transposition gets a name of its own.
    sandbox.write_song("songs/Bach 1 2.mid", [60, 62, 64]);
    let made =
        server.does(&json!({ "verb": "arrange", "song": "songs/Bach 1.mid", "changes": { "transpose": 2 } }));
    assert_eq!(made["output"], "out/songs/Bach 1 +2.mid");
    // The same arrangement once more is the same file.
    let again =
        server.does(&json!({ "verb": "arrange", "song": "songs/Bach 1.mid", "changes": { "transpose": 2 } }));
    assert_eq!(again["output"], made["output"]);
    // The folder of a training is named after its seed.
    let set: Vec<&str> = TINY.iter().copied().chain(["trainer.seed = 3"]).collect();
    let request = json!({ "verb": "train", "song": "songs/short.mid", "minutes": null, "set": set });
    assert_eq!(server.does(&request)["output"], "runs/short__fast__3");
}

#[test]
fn what_was_made_is_there_after_a_restart() {
    let sandbox = with_song();
    let server = Server::start(&sandbox);
    let song = "songs/short.mid";
    let shown = server.does(&json!({ "verb": "show", "song": song }));
    let about = server.get("song?name=songs/short.mid").json();
    assert_eq!((&about["is_ready"], &about["about"]), (&true.into(), &shown["output"]), "{about}");
    assert_eq!(
        sandbox.json("songs show songs/short.mid --json"),
        server.get("files/out/songs/short.json").json()
    );
    assert!(server.get("files/out/songs/short.wav").body.starts_with(b"RIFF"));
    let played = server.does(&json!({ "verb": "play", "song": song, "player": "scripted" }));
    assert!(played["command"].as_str().unwrap().starts_with("etude replay"), "{played}");
    server.does(&json!({ "verb": "perform", "song": song, "player": "scripted", "mode": "real" }));
    let performances = server.state()["performances"].clone();
    let of = |key: &str| -> Vec<Value> {
        performances.as_array().unwrap().iter().map(|performance| performance[key].clone()).collect()
    };
    assert_eq!(
        of("recording"),
        ["out/short-scripted-real/1/run-1.mcap", "out/short-scripted/1/recording.mcap"]
    );
    assert_eq!((of("player"), of("mode")), (vec!["scripted".into(); 2], vec!["real".into(), Value::Null]));
    assert_eq!(of("notes_due"), [3, 3]);
    // No policy has learned it, so the sight-reader plays at sight, and the page names it.
    assert_eq!(about["zero_shot"], true, "{about}");
    server.does(&json!({ "verb": "play", "song": song, "player": "best" }));
    let newest = server.state()["performances"][0].clone();
    assert_eq!(
        (&newest["recording"], &newest["player"]),
        (&"out/short/1/recording.mcap".into(), &about["policy"])
    );
    assert!(about["policy"].as_str().unwrap().ends_with("/sight-reader.safetensors"), "{about}");
    // Its replay names it too.
    let replay = server.get("files/out/short/1/replay.html");
    assert!(String::from_utf8_lossy(&replay.body).contains("sight-reader.safetensors"));
    // The same files as the verb writes by itself.
    sandbox.ok("play songs/short.mid --scripted -o same");
    assert_eq!(
        sandbox.bytes("same/1/performance.wav"),
        server.get("files/out/short-scripted/1/performance.wav").body
    );
    let [one, other] = of("recording").try_into().unwrap();
    let compared = server.does(&json!({ "verb": "compare", "one": one, "other": other }));
    let comparison = server.get(&format!("files/{}", compared["output"].as_str().unwrap())).json();
    assert_eq!(comparison["notes"].as_array().unwrap().len(), 3);
    server.train(&sandbox);
    let before = server.state();
    let (status, said) = server.end("TERM");
    assert_eq!(status.code(), Some(3), "{said}");

    let server = Server::start(&sandbox);
    let after = server.state();
    for key in ["songs", "performances", "comparisons", "folder"] {
        assert_eq!(before[key], after[key], "{key}");
    }
    // Each run of a performance has a page of its own.
    assert_eq!(after["performances"][1]["page"], "out/short-scripted-real/1/run-1.html");
    assert_eq!(after["jobs"], json!([]));
    let run = &after["runs"][0];
    assert_eq!((&run["run"], &run["song"]), (&"runs/short__fast__0".into(), &"short".into()));
    assert!(!run["f1"].as_array().unwrap().is_empty() && !run["reward_curve"].as_array().unwrap().is_empty());
    // What this page did not start, or is not there, it does not touch.
    for request in [
        json!({ "verb": "resume", "run": "/etc", "minutes": null }),
        json!({ "verb": "replay", "recording": "/etc/passwd" }),
        json!({ "verb": "compare", "one": "songs/short.mid", "other": "out/../x.mcap" }),
        json!({ "verb": "play", "song": "--help", "player": "scripted" }),
        json!({ "verb": "play", "song": song, "player": { "run": "runs/none" } }),
    ] {
        assert_eq!(server.post("jobs", request.to_string().as_bytes()).status, 404, "{request}");
    }
    for request in [json!({ "verb": "robot" }), json!({ "verb": "show", "song": song, "more": 1 }), json!(1)]
    {
        assert_eq!(server.post("jobs", request.to_string().as_bytes()).status, 400, "{request}");
    }
}

#[test]
fn a_training_is_stopped_and_resumed() {
    let sandbox = with_song();
    let server = Server::start(&sandbox);
    let wrong = json!({ "verb": "train", "song": "twinkle", "minutes": 0.1, "set": ["trainer.seed"] });
    let failed = server.ended(server.begin(&wrong));
    assert!(failed["state"] == "failed" && failed["log"].to_string().contains("trainer.seed"), "{failed}");
    let id = server.train(&sandbox);
    let again = json!({ "verb": "train", "song": "twinkle", "minutes": null, "set": [] });
    let second = server.post("jobs", again.to_string().as_bytes());
    assert!(second.status == 409 && second.why().contains("a training is running"), "{}", second.why());
    assert_eq!(server.post(&format!("jobs/{id}/stop"), b"").status, 200);
    let stopped = server.ended(id);
    assert_eq!(stopped["state"], "stopped", "{stopped}");
    assert_eq!(server.post("jobs/99/stop", b"").status, 404);
    let step = server.state()["runs"][0]["step"].as_u64().unwrap();
    assert!(step > 0);
    let on = server.begin(&json!({ "verb": "resume", "run": "runs/short__fast__0", "minutes": null }));
    wait_for("it makes more steps", || server.state()["runs"][0]["step"].as_u64().unwrap() > step);
    server.post(&format!("jobs/{on}/stop"), b"");
    assert_eq!(server.ended(on)["state"], "stopped");
    // It has learned less than the sight-reader plays, which therefore still plays the song.
    let about = server.get("song?name=songs/short.mid").json();
    assert!(about["policy"].as_str().unwrap().ends_with("/sight-reader.safetensors"), "{about}");
    let play =
        json!({ "verb": "play", "song": "songs/short.mid", "player": { "run": "runs/short__fast__0" } });
    assert_eq!(server.does(&play)["output"], "out/short-short__fast__0");
}

#[test]
fn planning_that_takes_long_is_stopped_and_says_how_far_it_is() {
    let sandbox = with_song();
    write_slow(&sandbox, "songs/chords.mid");
    let server = Server::start(&sandbox);
    let song = "songs/chords.mid";
    let show = server.begin(&json!({ "verb": "show", "song": song }));
    let again = server.post("jobs", json!({ "verb": "show", "song": song }).to_string().as_bytes());
    assert_eq!((again.status, again.why().as_str()), (409, "this job is already running"));
    let play = server.begin(&json!({ "verb": "play", "song": song, "player": "best" }));
    wait_for("it says how far it is", || {
        assert_eq!(server.job(play)["state"], "running", "{}", server.job(play));
        server.job(play)["log"].to_string().contains("planning the fingering, ")
    });
    for id in [show, play] {
        server.post(&format!("jobs/{id}/stop"), b"");
        assert_eq!(server.ended(id)["state"], "stopped");
    }
    assert!(!sandbox.path("out/songs/chords.json").exists(), "half of it is nothing");
    assert!(!sandbox.path("out/chords").exists());
}

#[test]
fn ctrl_c_ends_the_server_and_saves_what_runs() {
    // Also when it is killed, its jobs save themselves.
    for (name, code) in [("INT", Some(3)), ("KILL", None)] {
        let sandbox = with_song();
        let server = Server::start(&sandbox);
        server.train(&sandbox);
        let jobs = children_of(server.process.id());
        assert_eq!(jobs.len(), 1);
        let (status, said) = server.end(name);
        assert_eq!(status.code(), code, "{said}");
        let folder = ["train", "songs/short.mid", "-o", "runs/short__fast__0"];
        if name == "KILL" {
            wait_for("it stops", || !with_arguments(&folder).contains(&jobs[0]));
        }
        assert!(!with_arguments(&folder).contains(&jobs[0]), "{name}: it is left");
        let resumed = sandbox.ok("train --resume runs/short__fast__0 --minutes 0.01");
        assert!(resumed.contains("resumed at step"), "{name}: {resumed}");
    }
}

/// What the server needs to send a file does not depend on its length.
#[test]
fn a_long_file_is_sent_in_pieces() {
    let sandbox = with_song();
    std::fs::create_dir(sandbox.path("out")).unwrap();
    let length = 256 << 20;
    std::fs::File::create(sandbox.path("out/long.wav")).unwrap().set_len(length).unwrap();
    let server = Server::start(&sandbox);
    let mut stream = TcpStream::connect(&server.host).unwrap();
    let request = format!(
        "GET /{}/files/out/long.wav HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n",
        server.token, server.host
    );
    stream.write_all(request.as_bytes()).unwrap();
    let sent = std::io::copy(&mut stream, &mut std::io::sink()).unwrap();
    assert!((length..length + 2000).contains(&sent), "{sent} bytes");
    let status = std::fs::read_to_string(format!("/proc/{}/status", server.process.id())).unwrap();
    let most = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    let most: u64 = most.trim().trim_end_matches(" kB").parse().unwrap();
    assert!(most < 128 << 10, "{most} kB");
}

#[test]
fn a_port_that_is_taken_is_named() {
    let sandbox = with_song();
    let server = Server::start(&sandbox);
    let port = server.host.split_once(':').unwrap().1;
    let output = sandbox.command(&format!("serve --port {port}")).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = errors(&output);
    assert!(said.contains(&format!("port {port}")) && said.contains("--port"), "{said}");
    assert_eq!(sandbox.command("serve --port 70000").output().unwrap().status.code(), Some(2));
}

/// From the drop of a MIDI file to the sound, in Chromium.
#[test]
fn a_dropped_song_is_heard() {
    let sandbox = with_song();
    let song = root().join("songs/au-clair-de-la-lune.mid");
    let Some(mut tests) = browser_tests(&sandbox, &["test/work.test.mjs"]) else { return };
    let server = Server::start(&sandbox);
    tests.env("ETUDE_PAGE", server.address()).env("ETUDE_SONG", song).env("ETUDE_SETTINGS", TINY.join(" "));
    let said = all_pass(tests);
    println!("{}", said.lines().find(|line| line.contains("from the drop")).unwrap());
    assert!(sandbox.path("out/au-clair-de-la-lune/latest/performance.wav").is_file());
    assert_eq!(std::fs::read_dir(sandbox.path("screenshots")).unwrap().count(), 4);
}
