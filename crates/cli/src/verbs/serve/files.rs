//! The files of the working folder that the page shows.

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use http_body_util::Either;
use http_body_util::channel::Channel;
use hyper::StatusCode;
use hyper::header::{self, HeaderValue};

use super::message::{ApiError, HttpResponse, ResponseBody, response};

/// Folders whose files are served.
const FOLDERS: [&str; 2] = ["out", "songs"];
/// Extensions of the files that are served, and their content types.
const CONTENT_TYPES: [(&str, &str); 6] = [
    ("html", "text/html; charset=utf-8"),
    ("wav", "audio/wav"),
    ("mid", "audio/midi"),
    ("json", "application/json"),
    ("csv", "text/csv; charset=utf-8"),
    ("mcap", "application/octet-stream"),
];
/// Bytes of a file that are read at a time.
const CHUNK_BYTES: usize = 1 << 16;
/// A page from a file is sandboxed: its scripts run, but have no access to this server.
const POLICY: &str = "sandbox allow-scripts allow-downloads; frame-ancestors 'none'";

/// The file at `parts` below `root`, or its `range`.
pub fn file(root: &Path, parts: &[String], range: Option<&str>) -> Result<HttpResponse, ApiError> {
    let missing = || ApiError::not_found(format!("there is no file {} to show", parts.join("/")));
    let (mut file, content_type) = open(root, parts).ok_or_else(missing)?;
    let length = file.metadata().map_err(|_| missing())?.len();
    let (status, first, last) = match range.map(|range| bounds(range, length)) {
        None => (StatusCode::OK, 0, length),
        Some(Some((first, last))) => (StatusCode::PARTIAL_CONTENT, first, last),
        Some(None) => {
            return Err(ApiError::new(StatusCode::RANGE_NOT_SATISFIABLE, "the range is outside the file"));
        }
    };
    file.seek(SeekFrom::Start(first)).map_err(|_| missing())?;
    let mut response = response(status, content_type, POLICY, in_chunks(file, last - first));
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_LENGTH, (last - first).into());
    headers.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
    if status == StatusCode::PARTIAL_CONTENT {
        let range = format!("bytes {first}-{}/{length}", last - 1);
        headers.insert(header::CONTENT_RANGE, range.parse().expect("digits are a header"));
    }
    Ok(response)
}

/// The next `left` bytes of a file. The thread that reads them waits for the browser, and ends when
/// the browser closes the connection.
fn in_chunks(mut file: File, mut left: u64) -> ResponseBody {
    let (mut sender, body) = Channel::new(1);
    let runtime = tokio::runtime::Handle::current();
    tokio::task::spawn_blocking(move || {
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

/// The file and its content type, if it is in one of the folders, of one of the kinds, and no link
/// in its path leads out of the working folder.
fn open(root: &Path, parts: &[String]) -> Option<(File, &'static str)> {
    let is_plain =
        |part: &String| !(part.is_empty() || part.starts_with('.') || part.contains(['/', '\\', '\0']));
    if !FOLDERS.contains(&parts.first()?.as_str()) || !parts.iter().all(is_plain) {
        return None;
    }
    let path = root.join(parts.iter().collect::<PathBuf>()).canonicalize().ok()?;
    let extension = path.extension()?.to_str()?;
    let (_, content_type) = CONTENT_TYPES.iter().find(|(known, _)| *known == extension)?;
    let is_inside = path.starts_with(root) && path.is_file();
    Some((File::open(path).ok().filter(|_| is_inside)?, content_type))
}

/// First byte and the one after the last of a range such as `bytes=0-99`, `bytes=100-` or
/// `bytes=-100`; none outside the file.
fn bounds(range: &str, length: u64) -> Option<(u64, u64)> {
    let (first, last) = range.strip_prefix("bytes=")?.split_once('-')?;
    let (first, end) = match (first.parse::<u64>().ok(), last.parse::<u64>().ok()) {
        (Some(first), Some(last)) => (first, last.saturating_add(1).min(length)),
        (Some(first), None) if last.is_empty() => (first, length),
        (None, Some(count)) if first.is_empty() => (length.saturating_sub(count), length),
        _ => return None,
    };
    (first < end).then_some((first, end))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_stay_in_the_file() {
        for (range, expected) in [
            ("bytes=0-", Some((0, 10))),
            ("bytes=2-3", Some((2, 4))),
            ("bytes=9-99", Some((9, 10))),
            ("bytes=-4", Some((6, 10))),
            ("bytes=-99", Some((0, 10))),
            ("bytes=10-", None),
            ("bytes=5-4", None),
            ("bytes=0-18446744073709551615", Some((0, 10))),
            ("bytes=-", None),
            ("bytes=1-2,4-5", None),
            ("lines=1-2", None),
        ] {
            assert_eq!(bounds(range, 10), expected, "{range}");
        }
        assert_eq!(bounds("bytes=0-", 0), None);
    }

    #[test]
    fn no_path_leads_out_of_the_folder() {
        let outside = tempfile::tempdir().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().canonicalize().unwrap();
        std::fs::create_dir_all(root.join("out/a")).unwrap();
        std::fs::create_dir(root.join("other")).unwrap();
        for file in ["out/a/x.wav", "other/x.wav", "out/.x.wav", "x.wav"] {
            std::fs::write(root.join(file), file).unwrap();
        }
        std::fs::write(outside.path().join("x.wav"), "outside").unwrap();
        std::os::unix::fs::symlink(outside.path(), root.join("out/link")).unwrap();
        std::os::unix::fs::symlink(outside.path().join("x.wav"), root.join("out/x.wav")).unwrap();
        std::os::unix::fs::symlink(root.join("out/a"), root.join("out/b")).unwrap();
        let get = |path: &str| {
            let parts: Vec<String> = path.split('|').map(str::to_string).collect();
            Some(std::io::read_to_string(open(&root, &parts)?.0).unwrap())
        };
        assert_eq!(get("out|a|x.wav").unwrap(), "out/a/x.wav");
        assert_eq!(get("out|b|x.wav").unwrap(), "out/a/x.wav", "a link that stays inside");
        for refused in [
            "out|..|x.wav",
            "out|../x.wav",
            "..|x.wav",
            "out|a",
            "out",
            "",
            "x.wav",
            "other|x.wav",
            "out|.x.wav",
            "out|link|x.wav",
            "out|x.wav",
            "|etc|passwd",
            "out||a|x.wav",
            "out|a|x.wav\0",
        ] {
            assert_eq!(get(refused), None, "{refused:?}");
        }
        std::fs::write(root.join("out/key.pem"), "secret").unwrap();
        assert_eq!(get("out|key.pem"), None, "no verb writes such files");
    }
}
