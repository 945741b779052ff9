//! Authorisation: a request needs the token, the host name of this server and the origin of its
//! page.

use anyhow::anyhow;
use hyper::header::{HOST, HeaderMap, ORIGIN};
use hyper::{Method, StatusCode, Uri};

use super::message::ApiError;

const TOKEN_BYTES: usize = 16;

/// The token and the host names of the server.
pub struct Auth {
    token: String,
    hosts: [String; 2],
}

impl Auth {
    /// With a random token.
    pub fn new(port: u16) -> anyhow::Result<Self> {
        let mut bytes = [0; TOKEN_BYTES];
        getrandom::fill(&mut bytes)
            .map_err(|error| anyhow!("the system gives no random numbers: {error}"))?;
        let token = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Self { token, hosts: ["127.0.0.1", "localhost"].map(|host| format!("{host}:{port}")) })
    }

    /// The address of the page.
    pub fn address(&self) -> String {
        format!("http://{}/{}/", self.hosts[0], self.token)
    }

    /// Checks a request; gives the path after the token, not yet decoded.
    pub fn authorize<'a>(
        &self,
        method: &Method,
        uri: &'a Uri,
        headers: &HeaderMap,
    ) -> Result<&'a str, ApiError> {
        let text = |name: &str| headers.get(name).map(|value| value.to_str().unwrap_or_default());
        // Against DNS rebinding: a foreign page that resolves to this machine has its own name
        // here.
        let host = text(HOST.as_str()).unwrap_or_default();
        if !self.hosts.iter().any(|known| known == host) {
            return Err(refused(
                "the request names another host; open the address that `etude serve` printed",
            ));
        }
        let (token, rest) = uri.path().trim_start_matches('/').split_once('/').unwrap_or_default();
        if !is_same(token.as_bytes(), self.token.as_bytes()) {
            return Err(refused("open the complete address that `etude serve` printed last"));
        }
        // Against cross-site requests: what changes something must come from this page.
        let is_cross_site =
            text("sec-fetch-site").is_some_and(|site| !["same-origin", "none"].contains(&site));
        let is_same_origin = text(ORIGIN.as_str()).is_some_and(|origin| origin == format!("http://{host}"));
        if is_cross_site || (*method != Method::GET && !is_same_origin) {
            return Err(refused(
                "the request does not come from the page of this server; open the address that `etude serve` printed",
            ));
        }
        Ok(rest)
    }
}

fn refused(why: &str) -> ApiError {
    ApiError::new(StatusCode::FORBIDDEN, why)
}

/// Equality in constant time.
fn is_same(one: &[u8], other: &[u8]) -> bool {
    one.len() == other.len() && one.iter().zip(other).fold(0, |differs, (a, b)| differs | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a request with these headers is authorised; `{T}` in the path is the token.
    fn is_authorized(method: &Method, path: &str, headers: &[(&'static str, &str)]) -> bool {
        let auth = Auth::new(8000).unwrap();
        let uri: Uri = path.replace("{T}", &auth.token).parse().unwrap();
        let headers = headers.iter().map(|(name, value)| (name.parse().unwrap(), value.parse().unwrap()));
        auth.authorize(method, &uri, &headers.collect()).is_ok()
    }

    #[test]
    fn only_requests_of_this_page_are_authorised() {
        let host = ("host", "127.0.0.1:8000");
        let get = |path: &str, headers: &[_]| is_authorized(&Method::GET, path, headers);
        assert!(get("/{T}/", &[host]) && get("/{T}/state", &[("host", "localhost:8000")]));
        assert!(get("/{T}/", &[host, ("sec-fetch-site", "none")]));
        for path in ["/", "/{T}", "/x{T}/", "/00000000000000000000000000000000/", "//{T}0/state"] {
            assert!(!get(path, &[host]), "{path}");
        }
        for name in ["evil.example:8000", "127.0.0.1", "127.0.0.1:80", "localhost:8000.evil.example", ""] {
            assert!(!get("/{T}/", &[("host", name)]), "{name}");
        }
        assert!(!get("/{T}/", &[]));
        for site in ["cross-site", "same-site", "?"] {
            assert!(!get("/{T}/", &[host, ("sec-fetch-site", site)]), "{site}");
        }
        let post = |headers: &[_]| is_authorized(&Method::POST, "/{T}/jobs", headers);
        assert!(post(&[host, ("origin", "http://127.0.0.1:8000")]));
        for origin in ["null", "http://evil.example", "http://127.0.0.1:8001", "https://127.0.0.1:8000"] {
            assert!(!post(&[host, ("origin", origin)]), "{origin}");
        }
        assert!(!post(&[host]));
        assert!(!post(&[host, ("origin", "http://127.0.0.1:8000"), ("sec-fetch-site", "same-site")]));
    }

    #[test]
    fn every_server_has_another_token() {
        let (one, other) = (Auth::new(1).unwrap().token, Auth::new(1).unwrap().token);
        assert!(one.len() == 2 * TOKEN_BYTES && one != other);
        assert!(is_same(b"abc", b"abc") && !is_same(b"abc", b"abd") && !is_same(b"abc", b"ab"));
    }
}
