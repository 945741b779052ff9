//! HTTP requests and responses, and the errors of the API.

use std::collections::BTreeMap;

use http_body_util::channel::Channel;
use http_body_util::{Either, Full};
use hyper::body::Bytes;
use hyper::{Method, Response, StatusCode, header};
use serde_json::{Value, json};

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

/// Bytes, or a file in chunks that another thread reads.
pub type ResponseBody = Either<Full<Bytes>, Channel<Bytes, std::io::Error>>;
/// The response to a request.
pub type HttpResponse = Response<ResponseBody>;

/// A response; `policy` is its Content-Security-Policy.
pub fn response(status: StatusCode, content_type: &str, policy: &str, body: ResponseBody) -> HttpResponse {
    Response::builder()
        .status(status)
        .header(header::CONTENT_TYPE, content_type)
        .header(header::CONTENT_SECURITY_POLICY, policy)
        .header(header::X_CONTENT_TYPE_OPTIONS, "nosniff")
        .header(header::X_FRAME_OPTIONS, "DENY")
        // The address holds the token.
        .header(header::REFERRER_POLICY, "no-referrer")
        .header(header::CACHE_CONTROL, "no-store")
        .header("cross-origin-resource-policy", "same-origin")
        .body(body)
        .expect("the headers are our own")
}

/// A value as JSON.
pub fn json(status: StatusCode, value: &Value) -> HttpResponse {
    let body = Either::Left(Full::new(value.to_string().into()));
    response(status, "application/json", "default-src 'none'; sandbox", body)
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
        json(error.status, &json!({ "error": error.message }))
    }
}
