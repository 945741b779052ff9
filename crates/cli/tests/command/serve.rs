//! `etude serve`: who has access, what is kept, what runs and how it ends.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, ExitStatus, Stdio};
use std::time::Duration;

use etude_music::Song;
use serde_json::{Value, json};

use crate::processes::{children_of, signal, with_arguments};
use crate::replaying::{all_pass, browser_tests};
use crate::songs::write_slow;
use crate::training::LONGER;
use crate::{Desk, TINY, errors, root, wait_for};

/// A server that works in a desk.
struct Server {
    process: Child,
    /// `127.0.0.1:PORT`
    host: String,
    token: String,
}

/// Names and values.
type Headers<'a> = &'a [(&'a str, &'a str)];

/// What was answered.
struct Answer {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Answer {
    fn json(&self) -> Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&self.body)))
    }

    /// Why it was refused.
    fn why(&self) -> String {
        self.json()["error"].as_str().unwrap().to_string()
    }
}

impl Server {
    fn start(desk: &Desk) -> Self {
        let mut process =
            desk.command("serve").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let rest = line.trim_end().strip_prefix("http://").unwrap_or_else(|| panic!("{line:?}"));
        let (host, token) = rest.trim_end_matches('/').split_once('/').unwrap();
        Self { host: host.to_string(), token: token.to_string(), process }
    }

    fn address(&self) -> String {
        format!("http://{}/{}/", self.host, self.token)
    }

    /// Sends the bytes of a request, and reads the answer to it.
    fn raw(&self, request: &[u8]) -> Answer {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream.write_all(request).unwrap();
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").expect("an answer");
        let head = String::from_utf8(bytes[..end].to_vec()).unwrap().to_ascii_lowercase();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        Answer { status, head, body: bytes[end + 4..].to_vec() }
    }

    /// The same with these headers; `{T}` in the path is the token.
    fn ask(&self, method: &str, path: &str, headers: Headers, body: &[u8]) -> Answer {
        let mut head =
            format!("{method} {} HTTP/1.1\r\nConnection: close\r\n", path.replace("{T}", &self.token));
        for (name, value) in headers {
            head += &format!("{name}: {value}\r\n");
        }
        head += &format!("Content-Length: {}\r\n\r\n", body.len());
        self.raw(&[head.as_bytes(), body].concat())
    }

    fn get(&self, path: &str) -> Answer {
        self.ask("GET", &format!("/{{T}}/{path}"), &[("Host", &self.host)], b"")
    }

    fn post(&self, path: &str, body: &[u8]) -> Answer {
        let origin = format!("http://{}", self.host);
        self.ask("POST", &format!("/{{T}}/{path}"), &[("Host", &self.host), ("Origin", &origin)], body)
    }

    fn state(&self) -> Value {
        self.get("state").json()
    }

    /// Starts a verb; gives the number of its job.
    fn begin(&self, wanted: &Value) -> u64 {
        let answer = self.post("jobs", wanted.to_string().as_bytes());
        assert_eq!(answer.status, 200, "{}", String::from_utf8_lossy(&answer.body));
        answer.json()["id"].as_u64().unwrap()
    }

    fn job(&self, id: u64) -> Value {
        let jobs = self.state()["jobs"].clone();
        jobs.as_array().unwrap().iter().find(|job| job["id"] == id).unwrap().clone()
    }

    /// The job when it has ended.
    fn ended(&self, id: u64) -> Value {
        let mut job = Value::Null;
        wait_for("the job ends", || {
            job = self.job(id);
            job["state"] != "running" && job["state"] != "stopping"
        });
        job
    }

    /// Does a verb, which must succeed.
    fn does(&self, wanted: &Value) -> Value {
        let job = self.ended(self.begin(wanted));
        assert_eq!(job["state"], "done", "{job}");
        job
    }

    /// Starts a training of `short.mid` in the desk's songs, and waits until it has saved a checkpoint.
    fn train(&self, desk: &Desk) -> u64 {
        let sets: Vec<&str> =
            TINY.iter().copied().chain(LONGER.split_whitespace().filter(|word| *word != "--set")).collect();
        let set: Vec<&str> = sets.into_iter().chain(["trainer.total_steps=400000"]).collect();
        let id =
            self.begin(&json!({ "verb": "train", "song": "songs/short.mid", "minutes": null, "set": set }));
        let rows = desk.path("runs/short__fast__0/metrics.jsonl");
        wait_for("it trains", || {
            assert_eq!(self.job(id)["state"], "running", "{}", self.job(id));
            std::fs::read_to_string(&rows).is_ok_and(|text| text.lines().count() >= 3)
        });
        id
    }

    /// Sends a signal and waits for the end; also gives what was said.
    fn end(mut self, name: &str) -> (ExitStatus, String) {
        signal(self.process.id(), name);
        let status = self.process.wait().unwrap();
        let mut said = String::new();
        self.process.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        (status, said)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A desk whose `songs` has `short.mid`.
fn desk() -> Desk {
    let desk = Desk::new();
    std::fs::create_dir(desk.path("songs")).unwrap();
    std::fs::rename(desk.path("short.mid"), desk.path("songs/short.mid")).unwrap();
    desk
}

#[test]
fn only_the_page_of_this_server_has_access() {
    let desk = desk();
    let server = Server::start(&desk);
    let host = ("Host", server.host.as_str());
    let page = server.get("");
    assert_eq!(page.status, 200);
    for header in [
        "content-type: text/html; charset=utf-8",
        "x-content-type-options: nosniff",
        "referrer-policy: no-referrer",
        "frame-ancestors 'none'",
        "default-src 'none'; script-src 'sha256-",
    ] {
        assert!(page.head.contains(header), "{header}: {}", page.head);
    }
    assert!(!page.head.contains("unsafe") && !page.head.contains("access-control"), "{}", page.head);

    let song = desk.bytes("songs/short.mid");
    let origin = format!("http://{}", server.host);
    let elsewhere = format!("http://localhost:{}", server.host.split_once(':').unwrap().1);
    let refused: &[(&str, &str, Headers)] = &[
        ("GET", "/", &[host]),
        ("GET", "/state", &[host]),
        ("GET", "/0123456789abcdef0123456789abcdef/state", &[host]),
        ("GET", "/{T}/state", &[("Host", "evil.example")]),
        ("GET", "/{T}/state", &[]),
        ("GET", "/{T}/state", &[host, ("Sec-Fetch-Site", "cross-site")]),
        ("POST", "/{T}/songs?name=a.mid", &[host]),
        ("POST", "/{T}/songs?name=a.mid", &[host, ("Origin", "http://evil.example")]),
        ("POST", "/{T}/songs?name=a.mid", &[host, ("Origin", "null")]),
        ("POST", "/{T}/songs?name=a.mid", &[host, ("Origin", &elsewhere)]),
        ("POST", "/{T}/songs?name=a.mid", &[host, ("Origin", &origin), ("Sec-Fetch-Site", "same-site")]),
        ("POST", "/songs?name=a.mid", &[host, ("Origin", &origin)]),
        ("PUT", "/{T}/songs?name=a.mid", &[host, ("Origin", "http://evil.example")]),
    ];
    for (method, path, headers) in refused {
        let answer = server.ask(method, path, headers, &song);
        assert_eq!(answer.status, 403, "{method} {path} {headers:?}");
        assert!(!answer.why().is_empty() && !String::from_utf8_lossy(&answer.body).contains(&server.token));
    }
    assert!(!desk.path("out").exists(), "nothing was kept");
    // Other interfaces of this machine do not listen.
    let port = server.host.split_once(':').unwrap().1;
    assert!(TcpStream::connect(format!("127.0.0.2:{port}")).is_err());
    // Another server has another token.
    assert_ne!(Server::start(&desk).token, server.token);
}

#[test]
fn files_outside_the_working_folder_are_not_served() {
    let (desk, outside) = (desk(), tempfile::tempdir().unwrap());
    std::fs::create_dir(desk.path("out")).unwrap();
    for file in ["out/x.json", "x.json", "out/key.pem"] {
        std::fs::write(desk.path(file), "0123456789").unwrap();
    }
    std::fs::write(outside.path().join("x.json"), "outside").unwrap();
    std::os::unix::fs::symlink(outside.path(), desk.path("out/link")).unwrap();
    std::os::unix::fs::symlink(outside.path().join("x.json"), desk.path("out/linked.json")).unwrap();
    let server = Server::start(&desk);
    let served = server.get("files/out/x.json");
    assert!(served.status == 200 && served.body == b"0123456789", "{}", served.head);
    assert!(served.head.contains("content-type: application/json") && served.head.contains("sandbox"));
    assert!(served.head.contains("x-content-type-options: nosniff"));
    let far = outside.path().join("x.json").display().to_string();
    for path in [
        "files/out/../x.json",
        "files/../x.json",
        "files/out/%2e%2e/x.json",
        "files/out/..%2fx.json",
        "files/out/%2e%2e%2f%2e%2e%2fetc/passwd",
        "files/x.json",
        "files/out/key.pem",
        "files/out/link/x.json",
        "files/out/linked.json",
        "files/out",
        "files/out/",
        "files/",
        &format!("files{far}"),
        &format!("files/{}", far.replace('/', "%2f")),
        "files/out/x.json%00",
    ] {
        let answer = server.get(path);
        assert!(answer.status == 404 && !answer.why().contains("outside"), "{path}: {}", answer.head);
    }
    // A player asks for parts.
    let part = |range: &str| {
        let headers = [("Host", server.host.as_str()), ("Range", range)];
        server.ask("GET", "/{T}/files/out/x.json", &headers, b"")
    };
    let middle = part("bytes=2-4");
    assert!(
        middle.status == 206 && middle.body == b"234" && middle.head.contains("bytes 2-4/10"),
        "{}",
        middle.head
    );
    assert_eq!((part("bytes=7-").body.as_slice(), part("bytes=99-").status), (b"789".as_slice(), 416));
}

#[test]
fn a_dropped_file_is_bounded_and_must_be_midi() {
    let desk = desk();
    let server = Server::start(&desk);
    let song = desk.bytes("songs/short.mid");
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
        let answer = server.post(&format!("songs?name={name}"), bytes);
        assert_eq!(answer.status, 422, "{name}");
        assert!(answer.why().starts_with(&format!("{name} cannot be used: ")), "{}", answer.why());
    }
    assert_eq!(server.post("songs", &song).status, 400);
    assert!(!desk.path("out").exists(), "nothing was kept");

    let kept =
        |name: &str, bytes: &[u8]| server.post(&format!("songs?name={name}"), bytes).json()["song"].clone();
    assert_eq!(kept("..%2F..%2FF%C3%BCr%20Elise.mid", &song), "out/songs/Für Elise.mid");
    assert_eq!(desk.bytes("out/songs/Für Elise.mid"), song);
    // The same again is the same; another one, and one that is called like a built-in song, get names of their own.
    desk.write_song("other.mid", [64, 62, 60]);
    let other = desk.bytes("other.mid");
    assert_eq!(kept("F%C3%BCr%20Elise.mid", &song), "out/songs/Für Elise.mid");
    assert_eq!(kept("F%C3%BCr%20Elise.mid", &other), "out/songs/Für Elise 2.mid");
    assert_eq!(kept("short.mid", &song), "songs/short.mid");
    assert_eq!(kept("twinkle.mid", &song), "out/songs/twinkle 2.mid");
    assert_eq!(kept("-o.mid", &other), "out/songs/o.mid");
    // Who has learned a song of that name has not learned this one.
    let plays = |song: &str| {
        let about = server.get(&format!("song?name={song}")).json();
        assert_eq!(about["problem"], Value::Null, "{about}");
        let file = about["policy"].as_str().unwrap().rsplit('/').next().unwrap().to_string();
        (file, about["at_sight"].as_bool().unwrap())
    };
    assert_eq!(plays("out/songs/twinkle%202.mid"), ("sight-reader.safetensors".to_string(), true));
    assert_eq!(plays("twinkle"), ("twinkle.safetensors".to_string(), false));
    assert_eq!(server.get("song?name=other.mid").status, 404);
}

#[test]
fn a_song_that_the_keyboard_has_not_is_transposed() {
    let desk = desk();
    desk.write_song("songs/low.mid", [24, 26, 28]);
    let server = Server::start(&desk);
    let about = server.get("song?name=songs/low.mid").json();
    assert!(about["problem"].as_str().unwrap().contains("outside the keyboard"), "{about}");
    assert!(about["transpositions"].as_array().unwrap().contains(&12.into()), "{about}");
    let play = server.begin(&json!({ "verb": "play", "song": "songs/low.mid", "player": "scripted" }));
    let failed = server.ended(play);
    assert_eq!(failed["state"], "failed");
    assert!(failed["said"][0].as_str().unwrap().contains("outside the keyboard"), "{failed}");
    assert!(!failed["said"].to_string().contains("ended with"), "{failed}");
    let made = server.does(&json!({ "verb": "arrange", "song": "songs/low.mid", "transpose": 12 }));
    assert_eq!(made["makes"], "out/songs/low +12.mid");
    assert_eq!(server.get("song?name=out/songs/low%20%2B12.mid").json()["problem"], Value::Null);
    // Slower, and the upper voice alone.
    let wanted =
        json!({ "verb": "arrange", "song": "out/songs/low +12.mid", "stretch": 1.5, "melody": true });
    let made = server.does(&wanted);
    assert_eq!(made["makes"], "out/songs/low +12 x1.5 melody.mid");
    let slower = Song::load(desk.path("out/songs/low +12 x1.5 melody.mid")).unwrap();
    let before = Song::load(desk.path("out/songs/low +12.mid")).unwrap();
    assert!((slower.duration_secs() / before.duration_secs() - 1.5).abs() < 0.02);
}

#[test]
fn songs_whose_names_have_the_same_short_form_are_told_apart() {
    let desk = desk();
    desk.write_song("songs/Bach 1.mid", [60, 62, 64]);
    desk.write_song("songs/Bach_1.mid", [64, 62, 60]);
    desk.write_song("songs/песня.mid", [60, 62, 64]);
    let server = Server::start(&desk);
    let is_there = |name: &str| server.get(&format!("song?name=songs/{name}")).json()["is_there"].clone();
    server.does(&json!({ "verb": "show", "song": "songs/Bach 1.mid" }));
    assert_eq!((is_there("Bach%201.mid"), is_there("Bach_1.mid")), (true.into(), false.into()));
    // A name without a letter of ASCII.
    let shown = server.does(&json!({ "verb": "show", "song": "songs/песня.mid" }));
    assert_eq!(server.get(&format!("files/{}", shown["makes"].as_str().unwrap())).json()["title"], "песня");
    // A transposition gets a name of its own.
    desk.write_song("songs/Bach 1 2.mid", [60, 62, 64]);
    let made = server.does(&json!({ "verb": "arrange", "song": "songs/Bach 1.mid", "transpose": 2 }));
    assert_eq!(made["makes"], "out/songs/Bach 1 +2 2.mid");
    // The same arrangement once more is the same file.
    let again = server.does(&json!({ "verb": "arrange", "song": "songs/Bach 1.mid", "transpose": 2 }));
    assert_eq!(again["makes"], made["makes"]);
    // The folder of a training is named after its seed.
    let set: Vec<&str> = TINY.iter().copied().chain(["trainer.seed = 3"]).collect();
    let wanted = json!({ "verb": "train", "song": "songs/short.mid", "minutes": null, "set": set });
    assert_eq!(server.does(&wanted)["makes"], "runs/short__fast__3");
}

#[test]
fn what_was_made_is_there_after_a_restart() {
    let desk = desk();
    let server = Server::start(&desk);
    let song = "songs/short.mid";
    let shown = server.does(&json!({ "verb": "show", "song": song }));
    let about = server.get("song?name=songs/short.mid").json();
    assert_eq!((&about["is_there"], &about["about"]), (&true.into(), &shown["makes"]), "{about}");
    assert_eq!(
        desk.json("songs show songs/short.mid --json"),
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
    assert_eq!(of("recording"), ["out/short-scripted-real/run-1.mcap", "out/short-scripted/recording.mcap"]);
    assert_eq!((of("player"), of("mode")), (vec!["scripted".into(); 2], vec!["real".into(), Value::Null]));
    assert_eq!(of("notes_due"), [3, 3]);
    // No policy has learned it, so the sight-reader plays at sight, and the page names it.
    assert_eq!(about["at_sight"], true, "{about}");
    server.does(&json!({ "verb": "play", "song": song, "player": "best" }));
    let newest = server.state()["performances"][0].clone();
    assert_eq!(
        (&newest["recording"], &newest["player"]),
        (&"out/short/recording.mcap".into(), &about["policy"])
    );
    assert!(about["policy"].as_str().unwrap().ends_with("/sight-reader.safetensors"), "{about}");
    // Its replay names it too.
    let replay = server.get("files/out/short/replay.html");
    assert!(String::from_utf8_lossy(&replay.body).contains("sight-reader.safetensors"));
    // The same files as the verb writes by itself.
    desk.ok("play songs/short.mid --scripted -o same");
    assert_eq!(
        desk.bytes("same/performance.wav"),
        server.get("files/out/short-scripted/performance.wav").body
    );
    let [one, other] = of("recording").try_into().unwrap();
    let compared = server.does(&json!({ "verb": "compare", "one": one, "other": other }));
    let comparison = server.get(&format!("files/{}", compared["makes"].as_str().unwrap())).json();
    assert_eq!(comparison["notes"].as_array().unwrap().len(), 3);
    server.train(&desk);
    let before = server.state();
    let (status, said) = server.end("TERM");
    assert_eq!(status.code(), Some(3), "{said}");

    let server = Server::start(&desk);
    let after = server.state();
    for key in ["songs", "performances", "comparisons", "folder"] {
        assert_eq!(before[key], after[key], "{key}");
    }
    // Each run of a performance has a page of its own.
    assert_eq!(after["performances"][1]["page"], "out/short-scripted-real/run-1.html");
    assert_eq!(after["jobs"], json!([]));
    let run = &after["runs"][0];
    assert_eq!((&run["run"], &run["song"]), (&"runs/short__fast__0".into(), &"short".into()));
    assert!(!run["f1"].as_array().unwrap().is_empty() && !run["reward_curve"].as_array().unwrap().is_empty());
    // What this page did not start, or is not there, it does not touch.
    for wanted in [
        json!({ "verb": "resume", "run": "/etc", "minutes": null }),
        json!({ "verb": "replay", "recording": "/etc/passwd" }),
        json!({ "verb": "compare", "one": "songs/short.mid", "other": "out/../x.mcap" }),
        json!({ "verb": "play", "song": "--help", "player": "scripted" }),
        json!({ "verb": "play", "song": song, "player": { "run": "runs/none" } }),
    ] {
        assert_eq!(server.post("jobs", wanted.to_string().as_bytes()).status, 404, "{wanted}");
    }
    for wanted in [json!({ "verb": "robot" }), json!({ "verb": "show", "song": song, "more": 1 }), json!(1)] {
        assert_eq!(server.post("jobs", wanted.to_string().as_bytes()).status, 400, "{wanted}");
    }
}

#[test]
fn a_training_is_stopped_and_resumed() {
    let desk = desk();
    let server = Server::start(&desk);
    let wrong = json!({ "verb": "train", "song": "twinkle", "minutes": 0.1, "set": ["trainer.seed"] });
    let failed = server.ended(server.begin(&wrong));
    assert!(failed["state"] == "failed" && failed["said"].to_string().contains("trainer.seed"), "{failed}");
    let id = server.train(&desk);
    let again = json!({ "verb": "train", "song": "twinkle", "minutes": null, "set": [] });
    let second = server.post("jobs", again.to_string().as_bytes());
    assert!(second.status == 409 && second.why().contains("a training runs already"), "{}", second.why());
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
    assert_eq!(server.does(&play)["makes"], "out/short-short-fast-0");
}

#[test]
fn planning_that_takes_long_is_stopped_and_says_how_far_it_is() {
    let desk = desk();
    write_slow(&desk, "songs/chords.mid");
    let server = Server::start(&desk);
    let song = "songs/chords.mid";
    let show = server.begin(&json!({ "verb": "show", "song": song }));
    let again = server.post("jobs", json!({ "verb": "show", "song": song }).to_string().as_bytes());
    assert_eq!((again.status, again.why().as_str()), (409, "this runs already"));
    let play = server.begin(&json!({ "verb": "play", "song": song, "player": "best" }));
    wait_for("it says how far it is", || {
        assert_eq!(server.job(play)["state"], "running", "{}", server.job(play));
        server.job(play)["said"].to_string().contains("planning the fingering, ")
    });
    for id in [show, play] {
        server.post(&format!("jobs/{id}/stop"), b"");
        assert_eq!(server.ended(id)["state"], "stopped");
    }
    assert!(!desk.path("out/songs/chords.json").exists(), "half of it is nothing");
    assert!(!desk.path("out/chords").exists());
}

#[test]
fn ctrl_c_ends_the_server_and_saves_what_runs() {
    // Also when it is killed, its jobs save themselves.
    for (name, code) in [("INT", Some(3)), ("KILL", None)] {
        let desk = desk();
        let server = Server::start(&desk);
        server.train(&desk);
        let jobs = children_of(server.process.id());
        assert_eq!(jobs.len(), 1);
        let (status, said) = server.end(name);
        assert_eq!(status.code(), code, "{said}");
        let folder = ["train", "songs/short.mid", "-o", "runs/short__fast__0"];
        if name == "KILL" {
            wait_for("it stops", || !with_arguments(&folder).contains(&jobs[0]));
        }
        assert!(!with_arguments(&folder).contains(&jobs[0]), "{name}: it is left");
        let resumed = desk.ok("train --resume runs/short__fast__0 --minutes 0.01");
        assert!(resumed.contains("resumed at step"), "{name}: {resumed}");
    }
}

/// What the server needs to send a file does not depend on its length.
#[test]
fn a_long_file_is_sent_in_pieces() {
    let desk = desk();
    std::fs::create_dir(desk.path("out")).unwrap();
    let length = 256 << 20;
    std::fs::File::create(desk.path("out/long.wav")).unwrap().set_len(length).unwrap();
    let server = Server::start(&desk);
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
    let desk = desk();
    let server = Server::start(&desk);
    let port = server.host.split_once(':').unwrap().1;
    let output = desk.command(&format!("serve --port {port}")).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = errors(&output);
    assert!(said.contains(&format!("port {port}")) && said.contains("--port"), "{said}");
    assert_eq!(desk.command("serve --port 70000").output().unwrap().status.code(), Some(2));
}

/// From the drop of a MIDI file to the sound, in Chromium.
#[test]
fn a_dropped_song_is_heard() {
    let desk = desk();
    let song = root().join("songs/au-clair-de-la-lune.mid");
    let Some(mut tests) = browser_tests(&desk, &["test/work.test.mjs"]) else { return };
    let server = Server::start(&desk);
    tests.env("ETUDE_PAGE", server.address()).env("ETUDE_SONG", song).env("ETUDE_SETTINGS", TINY.join(" "));
    let said = all_pass(tests);
    println!("{}", said.lines().find(|line| line.contains("from the drop")).unwrap());
    assert!(desk.path("out/au-clair-de-la-lune/performance.wav").is_file());
    assert_eq!(std::fs::read_dir(desk.path("screenshots")).unwrap().count(), 4);
}
