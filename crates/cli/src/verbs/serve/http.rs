//! The server: HTTP/1.1 connections until a stop is requested.

use std::borrow::Cow;
use std::convert::Infallible;
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use http_body_util::{BodyExt as _, Limited};
use hyper::StatusCode;
use hyper::body::{Body as _, Incoming};
use hyper::header;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use percent_encoding::percent_decode_str;
use tokio::net::TcpListener as AsyncListener;

use super::message::{ApiError, HttpRequest, HttpResponse};
use super::router::Server;
use crate::output::note;

const MAX_REQUEST_BYTES: usize = 1 << 20;
const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest time between two checks of the request to stop.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Serves until `stop` is set, then stops the jobs and waits until they have ended.
pub fn serve(listener: TcpListener, server: &Arc<Server>, stop: &AtomicBool) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        listener.set_nonblocking(true)?;
        let listener = AsyncListener::from_std(listener)?;
        while !stop.load(Ordering::Relaxed) {
            match tokio::time::timeout(POLL_INTERVAL, listener.accept()).await {
                Ok(Ok((stream, _))) => drop(tokio::spawn(connection(stream, server.clone()))),
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
        async move { Ok::<_, Infallible>(respond(request, server).await.unwrap_or_else(HttpResponse::from)) }
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
    let decoded = |text: &str| percent_decode_str(text).decode_utf8().map(Cow::into_owned);
    let path = rest.split('/').map(decoded).collect::<Result<_, _>>();
    let path = path.map_err(|_| ApiError::bad_request("the address is malformed"))?;
    let query = form_urlencoded::parse(head.uri.query().unwrap_or_default().as_bytes());
    let query = query.into_owned().collect();
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
