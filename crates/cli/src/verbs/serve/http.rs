//! Requests and answers over HTTP/1.1.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::fs::File;
use std::io::Read as _;
use std::net::TcpListener;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

use http_body_util::{BodyExt as _, Limited};
use hyper::body::{Body, Bytes, Frame, Incoming, SizeHint};
use hyper::header::{self, HeaderName};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use serde_json::json;
use tokio::net::TcpListener as AsyncListener;
use tokio::sync::{Semaphore, mpsc};

use super::super::note;
use super::routes::Site;

/// The largest request, bytes.
const LARGEST: usize = 1 << 20;
/// How long a request may take to arrive.
const ARRIVAL: Duration = Duration::from_secs(10);
/// Connections at a time; more wait.
const MOST_CONNECTIONS: usize = 64;
/// The largest piece of a file that is in memory, bytes.
const PIECE: usize = 1 << 16;
/// Longest time between two looks at the request to stop.
const LOOK: Duration = Duration::from_millis(50);

/// A request that was admitted.
pub struct Request {
    pub method: Method,
    /// The parts of its path after the token, decoded.
    pub path: Vec<String>,
    /// The values after the `?`, decoded.
    pub query: BTreeMap<String, String>,
    /// Which part of a file is asked for.
    pub range: Option<String>,
    pub body: Bytes,
}

/// What is sent back.
pub struct Answer {
    pub status: StatusCode,
    /// The type of the content.
    pub kind: &'static str,
    /// What the content may do in a browser.
    pub policy: String,
    pub headers: Vec<(HeaderName, String)>,
    pub body: Content,
}

/// What an answer holds.
pub enum Content {
    Bytes(Bytes),
    /// The next so many bytes of a file, which are sent in pieces.
    Part(File, u64),
}

impl<T: Into<Bytes>> From<T> for Content {
    fn from(bytes: T) -> Self {
        Self::Bytes(bytes.into())
    }
}

impl Answer {
    /// A value as JSON.
    pub fn json(value: &serde_json::Value) -> Self {
        Self {
            status: StatusCode::OK,
            kind: "application/json",
            policy: "default-src 'none'; sandbox".to_string(),
            headers: Vec::new(),
            body: value.to_string().into(),
        }
    }
}

/// Why a request is not served, in words for the page.
#[derive(Debug)]
pub struct Refusal {
    status: StatusCode,
    why: String,
}

impl Refusal {
    pub fn new(status: StatusCode, why: impl Into<String>) -> Self {
        Self { status, why: why.into() }
    }

    /// Something that is not there.
    pub fn missing(why: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, why)
    }
}

/// What is wrong with what was asked for.
impl From<anyhow::Error> for Refusal {
    fn from(error: anyhow::Error) -> Self {
        Self::new(StatusCode::BAD_REQUEST, crate::message(&error))
    }
}

impl From<Refusal> for Answer {
    fn from(refusal: Refusal) -> Self {
        Self { status: refusal.status, ..Self::json(&json!({ "error": refusal.why })) }
    }
}

/// Answers until `stop` is set, then stops the jobs and waits until they have ended.
pub fn serve(listener: TcpListener, site: &Arc<Site>, stop: &AtomicBool) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        listener.set_nonblocking(true)?;
        let listener = AsyncListener::from_std(listener)?;
        let places = Arc::new(Semaphore::new(MOST_CONNECTIONS));
        while !stop.load(Ordering::Relaxed) {
            let Ok(Ok(place)) = tokio::time::timeout(LOOK, places.clone().acquire_owned()).await else {
                continue;
            };
            match tokio::time::timeout(LOOK, listener.accept()).await {
                Ok(Ok((stream, _))) => {
                    let site = site.clone();
                    tokio::spawn(async move {
                        connection(stream, site).await;
                        drop(place);
                    });
                }
                // A connection may be gone already, or too many files are open.
                Ok(Err(_)) => tokio::time::sleep(LOOK).await,
                Err(_) => {}
            }
        }
        drop(listener);
        site.jobs.stop_all();
        if site.jobs.any_runs() {
            note(
                "stopping all running commands; a training saves its state. Press Ctrl-C again to end the server at once",
            );
        }
        while site.jobs.any_runs() {
            tokio::time::sleep(LOOK).await;
        }
        anyhow::Ok(())
    })?;
    runtime.shutdown_background();
    Ok(())
}

async fn connection(stream: tokio::net::TcpStream, site: Arc<Site>) {
    let service = service_fn(move |request| {
        let site = site.clone();
        async move {
            let answer = answer(request, site).await.unwrap_or_else(Answer::from);
            Ok::<_, Infallible>(response(answer))
        }
    });
    let mut builder = http1::Builder::new();
    builder.timer(TokioTimer::new()).header_read_timeout(ARRIVAL);
    // An error here is a browser that has gone.
    let _ = builder.serve_connection(TokioIo::new(stream), service).await;
}

async fn answer(request: hyper::Request<Incoming>, site: Arc<Site>) -> Result<Answer, Refusal> {
    let too_large = || {
        let most = LARGEST >> 20;
        let why = format!(
            "it is larger than {most} MiB; put a larger MIDI file into the folder songs, and it is listed"
        );
        Refusal::new(StatusCode::PAYLOAD_TOO_LARGE, why)
    };
    let (head, body) = request.into_parts();
    let rest = site.gate.admit(&head.method, &head.uri, &head.headers)?;
    let malformed = || Refusal::new(StatusCode::BAD_REQUEST, "the address is malformed");
    let path = rest.split('/').map(decoded).collect::<Option<_>>().ok_or_else(malformed)?;
    let query = head.uri.query().unwrap_or_default().split('&').filter(|pair| !pair.is_empty());
    let pair = |pair: &str| {
        let (key, value) = pair.split_once('=')?;
        Some((decoded(key)?, decoded(value)?))
    };
    let query = query.map(pair).collect::<Option<_>>().ok_or_else(malformed)?;
    if body.size_hint().lower() > LARGEST as u64 {
        return Err(too_large());
    }
    let body = tokio::time::timeout(ARRIVAL, Limited::new(body, LARGEST).collect())
        .await
        .map_err(|_| Refusal::new(StatusCode::REQUEST_TIMEOUT, "the request did not arrive in time"))?
        .map_err(|_| too_large())?
        .to_bytes();
    let range = head.headers.get(header::RANGE).and_then(|range| range.to_str().ok()).map(str::to_string);
    let request = Request { method: head.method, path, query, range, body };
    // Files and songs are read in another thread than that of the connections.
    tokio::task::spawn_blocking(move || site.answer(&request)).await.map_err(|_| {
        Refusal::new(StatusCode::INTERNAL_SERVER_ERROR, "the server failed; its terminal says why")
    })?
}

fn response(answer: Answer) -> Response<Sent> {
    let mut response = Response::builder()
        .status(answer.status)
        .header(header::CONTENT_TYPE, answer.kind)
        .header(header::CONTENT_SECURITY_POLICY, answer.policy)
        .header(header::X_CONTENT_TYPE_OPTIONS, "nosniff")
        .header(header::X_FRAME_OPTIONS, "DENY")
        // The address holds the token.
        .header(header::REFERRER_POLICY, "no-referrer")
        .header(header::CACHE_CONTROL, "no-store")
        .header("cross-origin-resource-policy", "same-origin");
    for (name, value) in answer.headers {
        response = response.header(name, value);
    }
    response.body(Sent::new(answer.body)).expect("the headers are our own")
}

/// A body on its way: bytes that are there, or pieces that another thread reads.
struct Sent {
    pieces: mpsc::Receiver<std::io::Result<Bytes>>,
    left: u64,
}

impl Sent {
    /// Files are read in a thread that waits while nobody takes their pieces, and ends when the browser has gone.
    fn new(content: Content) -> Self {
        let (sender, pieces) = mpsc::channel(1);
        let left = match content {
            Content::Bytes(bytes) => {
                let length = bytes.len() as u64;
                // There is room for one.
                let _ = sender.try_send(Ok(bytes));
                length
            }
            Content::Part(mut file, length) => {
                tokio::task::spawn_blocking(move || {
                    let mut left = length;
                    while left > 0 {
                        let mut piece = vec![0; PIECE.min(left as usize)];
                        let read = file.read_exact(&mut piece);
                        left -= piece.len() as u64;
                        let failed = read.is_err();
                        if sender.blocking_send(read.map(|()| piece.into())).is_err() || failed {
                            break;
                        }
                    }
                });
                length
            }
        };
        Self { pieces, left }
    }
}

impl Body for Sent {
    type Data = Bytes;
    type Error = std::io::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<std::io::Result<Frame<Bytes>>>> {
        self.pieces.poll_recv(context).map(|piece| {
            piece.map(|piece| {
                piece.map(|piece| {
                    self.left -= piece.len() as u64;
                    Frame::data(piece)
                })
            })
        })
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.left)
    }
}

/// `text` with its `%41` as characters; none if it is malformed.
fn decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let [first, others @ ..] = rest {
        rest = others;
        if *first != b'%' {
            bytes.push(*first);
            continue;
        }
        let digits = std::str::from_utf8(rest.get(..2)?).ok()?;
        // `from_str_radix` accepts `+1`.
        if !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
            return None;
        }
        bytes.push(u8::from_str_radix(digits, 16).ok()?);
        rest = &rest[2..];
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::decoded;

    #[test]
    fn addresses_are_decoded_or_refused() {
        assert_eq!(decoded("F%C3%BCr%20Elise.mid").unwrap(), "Für Elise.mid");
        assert_eq!(decoded("a+b").unwrap(), "a+b");
        for malformed in ["%", "%4", "%zz", "%+1", "%ff"] {
            assert_eq!(decoded(malformed), None, "{malformed}");
        }
    }
}
