//! The files of the working folder that the page shows.

use std::fs::File;
use std::io::{Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use hyper::StatusCode;
use hyper::header;

use super::message::{ApiError, Content, HttpResponse};

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
/// A page from a file is sandboxed: its scripts run, but have no access to this server.
const POLICY: &str = "sandbox allow-scripts allow-downloads; frame-ancestors 'none'";

/// The file at `parts` below `root`, or its `range`.
pub fn file(root: &Path, parts: &[String], range: Option<&str>) -> Result<HttpResponse, ApiError> {
    let missing = || ApiError::not_found(format!("there is no file {} to show", parts.join("/")));
    let path = inside(root, parts).ok_or_else(missing)?;
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    let (_, content_type) =
        CONTENT_TYPES.iter().find(|(known, _)| *known == extension).ok_or_else(missing)?;
    let mut file = File::open(&path).map_err(|_| missing())?;
    let length = file.metadata().map_err(|_| missing())?.len();
    let (status, first, last) = match range.map(|range| bounds(range, length)) {
        None => (StatusCode::OK, 0, length),
        Some(Some((first, last))) => (StatusCode::PARTIAL_CONTENT, first, last),
        Some(None) => {
            return Err(ApiError::new(StatusCode::RANGE_NOT_SATISFIABLE, "the range is outside the file"));
        }
    };
    file.seek(SeekFrom::Start(first)).map_err(|_| missing())?;
    let mut headers = vec![(header::ACCEPT_RANGES, "bytes".to_string())];
    if status == StatusCode::PARTIAL_CONTENT {
        headers.push((header::CONTENT_RANGE, format!("bytes {first}-{}/{length}", last - 1)));
    }
    let body = Content::FilePart(file, last - first);
    Ok(HttpResponse { status, content_type, policy: POLICY.to_string(), headers, body })
}

/// The file, if it is in one of the folders and no link in its path leads out of the working
/// folder.
fn inside(root: &Path, parts: &[String]) -> Option<PathBuf> {
    let is_plain =
        |part: &String| !(part.is_empty() || part.starts_with('.') || part.contains(['/', '\\', '\0']));
    if !FOLDERS.contains(&parts.first()?.as_str()) || !parts.iter().all(is_plain) {
        return None;
    }
    let path = root.join(parts.iter().collect::<PathBuf>()).canonicalize().ok()?;
    (path.starts_with(root) && path.is_file()).then_some(path)
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
    use std::io::Read as _;

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
            let Content::FilePart(mut file, length) = file(&root, &parts, None).ok()?.body else {
                return None;
            };
            let mut text = String::new();
            assert_eq!(file.read_to_string(&mut text).unwrap() as u64, length);
            Some(text)
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
