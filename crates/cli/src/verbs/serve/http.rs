//! The server: HTTP/1.1 connections until a stop is requested.

use std::convert::Infallible;
use std::io::Read as _;
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use http_body_util::channel::Channel;
use http_body_util::{BodyExt as _, Either, Full, Limited};
use hyper::body::{Body as _, Bytes, Incoming};
use hyper::header;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::TcpListener as AsyncListener;
use tokio::sync::Semaphore;

use super::message::{ApiError, Content, HttpRequest, HttpResponse};
use super::router::Server;
use crate::output::note;

const MAX_REQUEST_BYTES: usize = 1 << 20;
const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);
/// Connections at a time; more wait.
const MAX_CONNECTIONS: usize = 64;
/// Bytes of a file that are read at a time.
const CHUNK_BYTES: usize = 1 << 16;
/// Longest time between two checks of the request to stop.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Bytes, or a file in chunks that another thread reads.
type ResponseBody = Either<Full<Bytes>, Channel<Bytes, std::io::Error>>;

/// Serves until `stop` is set, then stops the jobs and waits until they have ended.
pub fn serve(listener: TcpListener, server: &Arc<Server>, stop: &AtomicBool) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        listener.set_nonblocking(true)?;
        let listener = AsyncListener::from_std(listener)?;
        let connections = Arc::new(Semaphore::new(MAX_CONNECTIONS));
        while !stop.load(Ordering::Relaxed) {
            let permit = tokio::time::timeout(POLL_INTERVAL, connections.clone().acquire_owned()).await;
            let Ok(Ok(permit)) = permit else { continue };
            match tokio::time::timeout(POLL_INTERVAL, listener.accept()).await {
                Ok(Ok((stream, _))) => {
                    let server = server.clone();
                    tokio::spawn(async move {
                        connection(stream, server).await;
                        drop(permit);
                    });
                }
                // The connection may be closed already, or too many files are open.
                Ok(Err(_)) => tokio::time::sleep(POLL_INTERVAL).await,
                Err(_) => {}
            }
        }
        drop(listener);
        server.jobs.stop_all();
        if server.jobs.any_runs() {
            note(
                "stopping all running commands; a training saves its state. Press Ctrl-C again to end the server at once",
            );
        }
        while server.jobs.any_runs() {
            tokio::time::sleep(POLL_INTERVAL).await;
        }
        anyhow::Ok(())
    })?;
    runtime.shutdown_background();
    Ok(())
}

async fn connection(stream: tokio::net::TcpStream, server: Arc<Server>) {
    let service = service_fn(move |request| {
        let server = server.clone();
        async move {
            let response = respond(request, server).await.unwrap_or_else(HttpResponse::from);
            Ok::<_, Infallible>(with_headers(response))
        }
    });
    let mut builder = http1::Builder::new();
    builder.timer(TokioTimer::new()).header_read_timeout(REQUEST_TIMEOUT);
    // It fails when the browser closes the connection.
    let _ = builder.serve_connection(TokioIo::new(stream), service).await;
}

async fn respond(request: hyper::Request<Incoming>, server: Arc<Server>) -> Result<HttpResponse, ApiError> {
    let too_large = || {
        let message = format!(
            "it is larger than {} MiB; put a larger MIDI file into the folder songs, and it is listed",
            MAX_REQUEST_BYTES >> 20
        );
        ApiError::new(StatusCode::PAYLOAD_TOO_LARGE, message)
    };
    let (head, body) = request.into_parts();
    let rest = server.auth.authorize(&head.method, &head.uri, &head.headers)?;
    let malformed = || ApiError::bad_request("the address is malformed");
    let path = rest.split('/').map(decoded).collect::<Option<_>>().ok_or_else(malformed)?;
    let query = head.uri.query().unwrap_or_default().split('&').filter(|pair| !pair.is_empty());
    let pair = |pair: &str| {
        let (key, value) = pair.split_once('=')?;
        Some((decoded(key)?, decoded(value)?))
    };
    let query = query.map(pair).collect::<Option<_>>().ok_or_else(malformed)?;
    if body.size_hint().lower() > MAX_REQUEST_BYTES as u64 {
        return Err(too_large());
    }
    let body = tokio::time::timeout(REQUEST_TIMEOUT, Limited::new(body, MAX_REQUEST_BYTES).collect())
        .await
        .map_err(|_| ApiError::new(StatusCode::REQUEST_TIMEOUT, "the request did not arrive in time"))?
        .map_err(|_| too_large())?
        .to_bytes();
    let range = head.headers.get(header::RANGE).and_then(|range| range.to_str().ok()).map(str::to_string);
    let request = HttpRequest { method: head.method, path, query, range, body };
    // Files and songs are read in another thread than that of the connections.
    tokio::task::spawn_blocking(move || server.respond(&request)).await.map_err(|_| {
        ApiError::new(StatusCode::INTERNAL_SERVER_ERROR, "the server failed; its terminal says why")
    })?
}

fn with_headers(response: HttpResponse) -> Response<ResponseBody> {
    let mut builder = Response::builder()
        .status(response.status)
        .header(header::CONTENT_TYPE, response.content_type)
        .header(header::CONTENT_SECURITY_POLICY, response.policy)
        .header(header::X_CONTENT_TYPE_OPTIONS, "nosniff")
        .header(header::X_FRAME_OPTIONS, "DENY")
        // The address holds the token.
        .header(header::REFERRER_POLICY, "no-referrer")
        .header(header::CACHE_CONTROL, "no-store")
        .header("cross-origin-resource-policy", "same-origin");
    if let Content::FilePart(_, length) = response.body {
        builder = builder.header(header::CONTENT_LENGTH, length);
    }
    for (name, value) in response.headers {
        builder = builder.header(name, value);
    }
    builder.body(body(response.body)).expect("the headers are our own")
}

/// The body of a response. The thread that reads a file waits for the browser, and ends when the
/// browser closes the connection.
fn body(content: Content) -> ResponseBody {
    let (mut file, length) = match content {
        Content::Bytes(bytes) => return Either::Left(Full::new(bytes)),
        Content::FilePart(file, length) => (file, length),
    };
    let (mut sender, body) = Channel::new(1);
    let runtime = tokio::runtime::Handle::current();
    tokio::task::spawn_blocking(move || {
        let mut left = length;
        while left > 0 {
            let mut chunk = vec![0; CHUNK_BYTES.min(left as usize)];
            if let Err(error) = file.read_exact(&mut chunk) {
                return sender.abort(error);
            }
            left -= chunk.len() as u64;
            if runtime.block_on(sender.send_data(chunk.into())).is_err() {
                return;
            }
        }
    });
    Either::Right(body)
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
