//! HTTP requests and responses, and the errors of the API.

use std::collections::BTreeMap;
use std::fs::File;

use hyper::body::Bytes;
use hyper::header::HeaderName;
use hyper::{Method, StatusCode};
use serde_json::json;

use crate::output::error_message;

/// An authorised request.
pub struct HttpRequest {
    pub method: Method,
    /// The segments of the path after the token, decoded.
    pub path: Vec<String>,
    /// The query's parameters, decoded.
    pub query: BTreeMap<String, String>,
    /// The header `Range`.
    pub range: Option<String>,
    pub body: Bytes,
}

/// The response to a request.
pub struct HttpResponse {
    pub status: StatusCode,
    pub content_type: &'static str,
    /// The Content-Security-Policy.
    pub policy: String,
    pub headers: Vec<(HeaderName, String)>,
    pub body: Content,
}

/// The body of a response.
pub enum Content {
    Bytes(Bytes),
    /// The next so many bytes of a file, which are sent in chunks.
    FilePart(File, u64),
}

impl HttpResponse {
    /// A value as JSON.
    pub fn json(value: &serde_json::Value) -> Self {
        Self {
            status: StatusCode::OK,
            content_type: "application/json",
            policy: "default-src 'none'; sandbox".to_string(),
            headers: Vec::new(),
            body: Content::Bytes(value.to_string().into()),
        }
    }
}

/// Why a request is refused; the page shows the message.
#[derive(Debug)]
pub struct ApiError {
    status: StatusCode,
    message: String,
}

impl ApiError {
    pub fn new(status: StatusCode, message: impl Into<String>) -> Self {
        Self { status, message: message.into() }
    }

    pub fn not_found(message: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, message)
    }

    pub fn bad_request(message: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, message)
    }
}

impl From<anyhow::Error> for ApiError {
    fn from(error: anyhow::Error) -> Self {
        Self::bad_request(error_message(&error))
    }
}

impl From<ApiError> for HttpResponse {
    fn from(error: ApiError) -> Self {
        Self { status: error.status, ..Self::json(&json!({ "error": error.message })) }
    }
}
