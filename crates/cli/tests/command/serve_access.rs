//! `etude serve`: authorisation, and the files that it serves.

use std::net::TcpStream;

use crate::server::{Headers, Server, with_song};

#[test]
fn only_the_page_of_this_server_has_access() {
    let sandbox = with_song();
    let server = Server::start(&sandbox);
    let host = ("Host", server.host.as_str());
    let page = server.get("");
    assert_eq!(page.status, 200);
    for header in [
        "content-type: text/html; charset=utf-8",
        "x-content-type-options: nosniff",
        "referrer-policy: no-referrer",
        "frame-ancestors 'none'",
        "default-src 'none'; script-src 'sha256-",
    ] {
        assert!(page.head.contains(header), "{header}: {}", page.head);
    }
    assert!(!page.head.contains("unsafe") && !page.head.contains("access-control"), "{}", page.head);

    let song = sandbox.bytes("songs/short.mid");
    let origin = format!("http://{}", server.host);
    let elsewhere = format!("http://localhost:{}", server.host.split_once(':').unwrap().1);
    let refused: &[(&str, &str, Headers)] = &[
        ("GET", "/", &[host]),
        ("GET", "/state", &[host]),
        ("GET", "/0123456789abcdef0123456789abcdef/state", &[host]),
        ("GET", "/{T}/state", &[("Host", "evil.example")]),
        ("GET", "/{T}/state", &[]),
        ("GET", "/{T}/state", &[host, ("Sec-Fetch-Site", "cross-site")]),
        ("POST", "/{T}/songs?name=a.mid", &[host]),
        ("POST", "/{T}/songs?name=a.mid", &[host, ("Origin", "http://evil.example")]),
        ("POST", "/{T}/songs?name=a.mid", &[host, ("Origin", "null")]),
        ("POST", "/{T}/songs?name=a.mid", &[host, ("Origin", &elsewhere)]),
        ("POST", "/{T}/songs?name=a.mid", &[host, ("Origin", &origin), ("Sec-Fetch-Site", "same-site")]),
        ("POST", "/songs?name=a.mid", &[host, ("Origin", &origin)]),
        ("PUT", "/{T}/songs?name=a.mid", &[host, ("Origin", "http://evil.example")]),
    ];
    for (method, path, headers) in refused {
        let response = server.ask(method, path, headers, &song);
        assert_eq!(response.status, 403, "{method} {path} {headers:?}");
        assert!(
            !response.why().is_empty() && !String::from_utf8_lossy(&response.body).contains(&server.token)
        );
    }
    assert!(!sandbox.path("out").exists(), "nothing was kept");
    // Other interfaces of this machine do not listen.
    let port = server.host.split_once(':').unwrap().1;
    assert!(TcpStream::connect(format!("127.0.0.2:{port}")).is_err());
    // Another server has another token.
    assert_ne!(Server::start(&sandbox).token, server.token);
}

#[test]
fn files_outside_the_working_folder_are_not_served() {
    let (sandbox, outside) = (with_song(), tempfile::tempdir().unwrap());
    std::fs::create_dir(sandbox.path("out")).unwrap();
    for file in ["out/x.json", "x.json", "out/key.pem"] {
        std::fs::write(sandbox.path(file), "0123456789").unwrap();
    }
    std::fs::write(outside.path().join("x.json"), "outside").unwrap();
    std::os::unix::fs::symlink(outside.path(), sandbox.path("out/link")).unwrap();
    std::os::unix::fs::symlink(outside.path().join("x.json"), sandbox.path("out/linked.json")).unwrap();
    let server = Server::start(&sandbox);
    let served = server.get("files/out/x.json");
    assert!(served.status == 200 && served.body == b"0123456789", "{}", served.head);
    assert!(served.head.contains("content-type: application/json") && served.head.contains("sandbox"));
    assert!(served.head.contains("x-content-type-options: nosniff"));
    let far = outside.path().join("x.json").display().to_string();
    for path in [
        "files/out/../x.json",
        "files/../x.json",
        "files/out/%2e%2e/x.json",
        "files/out/..%2fx.json",
        "files/out/%2e%2e%2f%2e%2e%2fetc/passwd",
        "files/x.json",
        "files/out/key.pem",
        "files/out/link/x.json",
        "files/out/linked.json",
        "files/out",
        "files/out/",
        "files/",
        &format!("files{far}"),
        &format!("files/{}", far.replace('/', "%2f")),
        "files/out/x.json%00",
    ] {
        let response = server.get(path);
        assert!(response.status == 404 && !response.why().contains("outside"), "{path}: {}", response.head);
    }
    // A player asks for parts.
    let part = |range: &str| {
        let headers = [("Host", server.host.as_str()), ("Range", range)];
        server.ask("GET", "/{T}/files/out/x.json", &headers, b"")
    };
    let middle = part("bytes=2-4");
    assert!(
        middle.status == 206 && middle.body == b"234" && middle.head.contains("bytes 2-4/10"),
        "{}",
        middle.head
    );
    assert_eq!((part("bytes=7-").body.as_slice(), part("bytes=99-").status), (b"789".as_slice(), 416));
}
