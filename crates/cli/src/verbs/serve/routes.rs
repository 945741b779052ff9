//! Which part of the server answers which request.

use etude_show::work_page;
use hyper::{Method, StatusCode};
use serde_json::json;

use super::desk::Desk;
use super::files;
use super::gate::Gate;
use super::http::{Answer, Refusal, Request};
use super::jobs::Jobs;
use super::orders::Wanted;

/// The whole server.
pub struct Site {
    pub gate: Gate,
    pub desk: Desk,
    pub jobs: Jobs,
}

impl Site {
    /// Answers a request that was admitted.
    pub fn answer(&self, request: &Request) -> Result<Answer, Refusal> {
        let path: Vec<&str> = request.path.iter().map(String::as_str).collect();
        let value = |name: &str| {
            let found = request.query.get(name).map(String::as_str);
            found.ok_or_else(|| Refusal::new(StatusCode::BAD_REQUEST, format!("`{name}` is missing")))
        };
        match (&request.method, path.as_slice()) {
            (&Method::GET, [""]) => {
                let (page, policy) = work_page();
                let (body, policy) = (page.into(), format!("{policy}; frame-ancestors 'none'"));
                Ok(Answer { kind: "text/html; charset=utf-8", policy, body, ..Answer::json(&json!(null)) })
            }
            (&Method::GET, ["state"]) => Ok(Answer::json(&json!({
                "folder": self.desk.root.display().to_string(),
                "songs": self.desk.songs(),
                "jobs": self.jobs.seen(),
                "performances": self.desk.performances(),
                "comparisons": self.desk.comparisons(),
                "runs": self.desk.runs(),
            }))),
            (&Method::GET, ["song"]) => Ok(Answer::json(&self.desk.describe(value("name")?)?)),
            (&Method::GET, ["files", ..]) => {
                files::file(&self.desk.root, &request.path[1..], request.range.as_deref())
            }
            (&Method::POST, ["songs"]) => {
                let song = self.desk.add_song(value("name")?, &request.body)?;
                Ok(Answer::json(&json!({ "song": song })))
            }
            (&Method::POST, ["jobs"]) => {
                let wanted: Wanted = serde_json::from_slice(&request.body)
                    .map_err(|error| Refusal::new(StatusCode::BAD_REQUEST, error.to_string()))?;
                let id = self.jobs.start(wanted.order(&self.desk)?)?;
                Ok(Answer::json(&json!({ "id": id })))
            }
            (&Method::POST, ["jobs", id, "stop"]) => {
                let id = id.parse().map_err(|_| Refusal::missing("there is no such job; reload the page"))?;
                self.jobs.stop(id)?;
                Ok(Answer::json(&json!({ "id": id })))
            }
            _ => Err(Refusal::missing("there is nothing at this address; reload the page")),
        }
    }
}
