//! The addresses of the server and what answers each.

use etude_show::work_page;
use http_body_util::{Either, Full};
use hyper::{Method, StatusCode};
use serde_json::json;

use super::api::ApiRequest;
use super::auth::Auth;
use super::files;
use super::jobs::Jobs;
use super::message::{ApiError, HttpRequest, HttpResponse, json as json_response, response};
use super::workspace::Workspace;

/// The state of the server.
pub struct Server {
    pub auth: Auth,
    pub workspace: Workspace,
    pub jobs: Jobs,
}

impl Server {
    /// Responds to an authorised request.
    pub fn respond(&self, request: &HttpRequest) -> Result<HttpResponse, ApiError> {
        let path: Vec<&str> = request.path.iter().map(String::as_str).collect();
        let parameter = |name: &str| {
            let value = request.query.get(name).map(String::as_str);
            value.ok_or_else(|| ApiError::bad_request(format!("`{name}` is missing")))
        };
        let value = match (&request.method, path.as_slice()) {
            (&Method::GET, [""]) => return Ok(page()),
            (&Method::GET, ["files", ..]) => {
                return files::file(&self.workspace.root, &request.path[1..], request.range.as_deref());
            }
            (&Method::GET, ["state"]) => json!({
                "folder": self.workspace.root.display().to_string(),
                "songs": self.workspace.songs(),
                "jobs": self.jobs.status(),
                "performances": self.workspace.performances().iter().map(|it| &it.about).collect::<Vec<_>>(),
                "comparisons": self.workspace.comparisons(),
                "runs": self.workspace.runs(),
            }),
            (&Method::GET, ["song"]) => self.workspace.describe(parameter("name")?)?,
            (&Method::POST, ["songs"]) => {
                json!({ "song": self.workspace.add_song(parameter("name")?, &request.body)? })
            }
            (&Method::POST, ["jobs"]) => {
                let asked: ApiRequest = serde_json::from_slice(&request.body)
                    .map_err(|error| ApiError::bad_request(error.to_string()))?;
                json!({ "id": self.jobs.start(asked.job(&self.workspace)?)? })
            }
            (&Method::POST, ["jobs", id, "stop"]) => {
                self.jobs.stop(id)?;
                json!({ "id": id })
            }
            _ => return Err(ApiError::not_found("there is nothing at this address; reload the page")),
        };
        Ok(json_response(StatusCode::OK, &value))
    }
}

fn page() -> HttpResponse {
    let (page, policy) = work_page();
    let policy = format!("{policy}; frame-ancestors 'none'");
    response(StatusCode::OK, "text/html; charset=utf-8", &policy, Either::Left(Full::new(page.into())))
}
