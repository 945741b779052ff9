//! `etude serve` in a process of its own, and its client.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, ExitStatus, Stdio};
use std::time::Duration;

use serde_json::{Value, json};

use crate::processes::signal;
use crate::training::LONGER;
use crate::{Sandbox, TINY, wait_for};

/// A server that works in a sandbox.
pub struct Server {
    pub process: Child,
    /// `127.0.0.1:PORT`
    pub host: String,
    pub token: String,
}

/// Names and values.
pub type Headers<'a> = &'a [(&'a str, &'a str)];

/// What was answered.
pub struct Response {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Response {
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&self.body)))
    }

    /// Why it was refused.
    pub fn why(&self) -> String {
        self.json()["error"].as_str().unwrap().to_string()
    }
}

impl Server {
    pub fn start(sandbox: &Sandbox) -> Self {
        let mut process =
            sandbox.command("serve").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let rest = line.trim_end().strip_prefix("http://").unwrap_or_else(|| panic!("{line:?}"));
        let (host, token) = rest.trim_end_matches('/').split_once('/').unwrap();
        Self { host: host.to_string(), token: token.to_string(), process }
    }

    pub fn address(&self) -> String {
        format!("http://{}/{}/", self.host, self.token)
    }

    /// Sends the bytes of a request, and reads the response to it.
    pub fn raw(&self, request: &[u8]) -> Response {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream.write_all(request).unwrap();
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").expect("an response");
        let head = String::from_utf8(bytes[..end].to_vec()).unwrap().to_ascii_lowercase();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        Response { status, head, body: bytes[end + 4..].to_vec() }
    }

    /// The same with these headers; `{T}` in the path is the token.
    pub fn ask(&self, method: &str, path: &str, headers: Headers, body: &[u8]) -> Response {
        let mut head =
            format!("{method} {} HTTP/1.1\r\nConnection: close\r\n", path.replace("{T}", &self.token));
        for (name, value) in headers {
            head += &format!("{name}: {value}\r\n");
        }
        head += &format!("Content-Length: {}\r\n\r\n", body.len());
        self.raw(&[head.as_bytes(), body].concat())
    }

    pub fn get(&self, path: &str) -> Response {
        self.ask("GET", &format!("/{{T}}/{path}"), &[("Host", &self.host)], b"")
    }

    pub fn post(&self, path: &str, body: &[u8]) -> Response {
        let origin = format!("http://{}", self.host);
        self.ask("POST", &format!("/{{T}}/{path}"), &[("Host", &self.host), ("Origin", &origin)], body)
    }

    pub fn state(&self) -> Value {
        self.get("state").json()
    }

    /// Starts a verb; gives the number of its job.
    pub fn begin(&self, request: &Value) -> u64 {
        let response = self.post("jobs", request.to_string().as_bytes());
        assert_eq!(response.status, 200, "{}", String::from_utf8_lossy(&response.body));
        response.json()["id"].as_u64().unwrap()
    }

    pub fn job(&self, id: u64) -> Value {
        let jobs = self.state()["jobs"].clone();
        jobs.as_array().unwrap().iter().find(|job| job["id"] == id).unwrap().clone()
    }

    /// The job when it has ended.
    pub fn ended(&self, id: u64) -> Value {
        let mut job = Value::Null;
        wait_for("the job ends", || {
            job = self.job(id);
            job["state"] != "running" && job["state"] != "stopping"
        });
        job
    }

    /// Does a verb, which must succeed.
    pub fn does(&self, request: &Value) -> Value {
        let job = self.ended(self.begin(request));
        assert_eq!(job["state"], "done", "{job}");
        job
    }

    /// Starts a training of `short.mid` in the sandbox's songs, and waits until it has saved a
    /// checkpoint.
    pub fn train(&self, sandbox: &Sandbox) -> u64 {
        let sets: Vec<&str> =
            TINY.iter().copied().chain(LONGER.split_whitespace().filter(|word| *word != "--set")).collect();
        let set: Vec<&str> = sets.into_iter().chain(["trainer.total_steps=400000"]).collect();
        let id =
            self.begin(&json!({ "verb": "train", "song": "songs/short.mid", "minutes": null, "set": set }));
        let rows = sandbox.path("runs/short__fast__0/metrics.jsonl");
        wait_for("it trains", || {
            assert_eq!(self.job(id)["state"], "running", "{}", self.job(id));
            std::fs::read_to_string(&rows).is_ok_and(|text| text.lines().count() >= 3)
        });
        id
    }

    /// Sends a signal and waits for the end; also gives what was said.
    pub fn end(mut self, name: &str) -> (ExitStatus, String) {
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

/// A sandbox whose `songs` has `short.mid`.
pub fn with_song() -> Sandbox {
    let sandbox = Sandbox::new();
    std::fs::create_dir(sandbox.path("songs")).unwrap();
    std::fs::rename(sandbox.path("short.mid"), sandbox.path("songs/short.mid")).unwrap();
    sandbox
}
