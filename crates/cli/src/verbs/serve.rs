//! `etude serve`: a page for one's work, on this machine alone.
//!
//! Every button of the page runs a verb of this program in a process of its own ([`jobs`]), and all
//! that the page shows is in files ([`workspace`]). So nothing is lost when the page or the server
//! ends.

mod api;
mod auth;
mod files;
mod http;
mod jobs;
mod message;
mod router;
mod workspace;

use std::io::ErrorKind;
use std::net::{Ipv4Addr, TcpListener};
use std::sync::Arc;

use anyhow::{Context as _, anyhow};

use self::auth::Auth;
use self::jobs::Jobs;
use self::router::Server;
use self::workspace::Workspace;
use crate::output::{VerbEnd, line, note};
use crate::progress::stop_flag;

/// Where the server listens.
#[derive(clap::Args)]
#[command(after_help = "\
Drop a MIDI file on the page: it shows which notes are hard, plays the song, trains, performs on the \
twin and compares. It runs other `etude` commands, each in its own process, and shows their command \
lines. It uses the folder in which it is started: dropped songs are in out/songs, performances in out, \
trainings in runs.

The address contains a random token. A request without it is refused. Only programs of this machine \
reach the page; from another machine use `ssh -L 8000:127.0.0.1:8000 HOST` and `etude serve --port \
8000`. Ctrl-C stops all running commands, saves a training, and ends the server with exit code 3.

Examples:
  etude serve
  etude serve --port 8000")]
pub struct Args {
    /// The port; one that is free if not given
    #[arg(long, default_value_t = 0, value_name = "N", hide_default_value = true)]
    port: u16,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let stop = stop_flag()?;
    let folder = std::env::current_dir().and_then(|folder| folder.canonicalize());
    let folder = folder.context("the working folder cannot be read")?;
    let listener = listen(args.port)?;
    let port = listener.local_addr()?.port();
    let auth = Auth::new(port)?;
    let address = auth.address();
    let jobs = Jobs::new(std::env::current_exe().context("this program's file cannot be found")?);
    let server = Arc::new(Server { auth, workspace: Workspace::new(folder), jobs });
    line(&address)?;
    note(
        "Open this address in a browser on this machine; Ctrl-C ends the server and saves a running training",
    );
    http::serve(listener, &server, &stop)?;
    Ok(VerbEnd::Stopped)
}

/// A port on this machine that no other machine reaches.
fn listen(port: u16) -> anyhow::Result<TcpListener> {
    TcpListener::bind((Ipv4Addr::LOCALHOST, port))
        .map_err(|error| anyhow!("cannot serve on port {port}: {}", cause(&error)))
}

/// Why a port cannot be used, and what to do.
fn cause(error: &std::io::Error) -> String {
    let why = match error.kind() {
        ErrorKind::AddrInUse => "another program uses it".to_string(),
        ErrorKind::PermissionDenied => "this user may not use ports below 1024".to_string(),
        _ => error.to_string(),
    };
    format!("{why}; choose another port with --port, for example --port 8000, or leave --port away")
}

#[cfg(test)]
mod tests {
    use std::io::{Error, ErrorKind};

    use super::cause;

    #[test]
    fn a_port_that_cannot_be_used_is_refused_with_its_cause() {
        let forbidden = cause(&Error::from(ErrorKind::PermissionDenied));
        assert!(
            forbidden.contains("this user may not use ports below 1024") && forbidden.contains("--port 8000")
        );
        assert!(cause(&Error::from(ErrorKind::AddrInUse)).contains("another program uses it"));
        assert!(cause(&Error::other("no loopback")).contains("no loopback"));
    }
}
