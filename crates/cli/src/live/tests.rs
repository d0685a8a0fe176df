//! The server as a client sees it.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use super::{Ended, Live, Snapshot, View};

/// What comes back to `request`, as text.
fn message(address: SocketAddr, request: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).expect("a connection");
    stream.set_read_timeout(Some(Duration::from_secs(20))).expect("a time");
    stream.write_all(request).expect("it takes the request");
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).expect("an answer");
    String::from_utf8_lossy(&answer).into_owned()
}

fn get(live: &Live, path: &str) -> String {
    let request = format!("GET {path} HTTP/1.1\r\nHost: {}\r\n\r\n", live.address());
    message(live.address(), request.as_bytes())
}

fn with_host(live: &Live, host: &str) -> String {
    message(live.address(), format!("GET / HTTP/1.1\r\n{host}\r\n").as_bytes())
}

fn live() -> Live {
    let live = Live::start(0).expect("a port");
    let (name, held_out, psnr) = ("front".to_owned(), true, Some(30.5));
    let [picture, target, difference] = ["picture", "target", "difference"].map(|s| s.as_bytes());
    let (picture, target, difference) = (picture.into(), target.into(), difference.into());
    let views = vec![View { name, held_out, psnr, picture, target, difference }];
    let mesh = Some(b"{\"meshes\":[]}"[..].into());
    let ended = Some(Ended::Done("all is well".to_owned()));
    live.publish(Snapshot { step: 7, steps: 9, views, mesh, ended, ..Snapshot::default() });
    live
}

/// The number under `"version"` in an answer.
fn version(answer: &str) -> u64 {
    let (_, rest) = answer.split_once("\"version\":").expect("a version");
    let end = rest.find(|c: char| !c.is_ascii_digit()).expect("more after it");
    rest[..end].parse().expect("a number")
}

#[test]
fn each_path_has_its_type_and_is_kept_nowhere() {
    let live = live();
    for (path, kind, part) in [
        ("/", "text/html; charset=utf-8", "<!doctype html>"),
        ("/page.js", "text/javascript; charset=utf-8", "/state.json"),
        ("/viewer.js", "text/javascript; charset=utf-8", "bokashiViewer"),
        ("/page.css", "text/css; charset=utf-8", ".viewer canvas"),
        ("/state.json", "application/json", "\"step\":7"),
        ("/state.json?after=1", "application/json", "\"message\":\"all is well\""),
        ("/mesh.json?version=5", "application/json", "{\"meshes\":[]}"),
        ("/view/0/picture.png", "image/png", "\r\n\r\npicture"),
        ("/view/0/target.png?version=5", "image/png", "\r\n\r\ntarget"),
        ("/view/0/difference.png", "image/png", "\r\n\r\ndifference"),
    ] {
        let answer = get(&live, path);
        assert!(answer.starts_with("HTTP/1.1 200 OK\r\n"), "{path}: {answer}");
        assert!(answer.contains(&format!("\r\nContent-Type: {kind}\r\n")), "{path}: {answer}");
        assert!(answer.contains("\r\nCache-Control: no-store\r\n"), "{path}");
        assert!(answer.contains(part), "{path}: {answer}");
    }
}

#[test]
fn other_paths_are_not_found() {
    let live = live();
    for path in [
        "/index.html",
        "/view/1/picture.png",
        "/view/-1/picture.png",
        "/view/99999999999999999999999/picture.png",
        "/view/0/picture",
        "/view/0/other.png",
        "/../Cargo.toml",
        "/%2e%2e/Cargo.toml",
        "//",
        "http://127.0.0.1/",
        "*",
    ] {
        let answer = get(&live, path);
        assert!(answer.starts_with("HTTP/1.1 404 Not Found\r\n"), "{path}: {answer}");
    }
    let empty = Live::start(0).expect("a port");
    assert!(get(&empty, "/mesh.json").starts_with("HTTP/1.1 404"));
    assert!(get(&empty, "/view/0/picture.png").starts_with("HTTP/1.1 404"));
    assert!(get(&empty, "/state.json").contains("\"begun\":false"));
}

#[test]
fn only_get_is_allowed_and_bodies_are_refused() {
    let live = live();
    for method in ["POST", "HEAD", "PUT", "OPTIONS", "DELETE", "BREW"] {
        let request = format!("{method} / HTTP/1.1\r\nHost: localhost\r\n\r\n");
        let answer = message(live.address(), request.as_bytes());
        assert!(answer.starts_with("HTTP/1.1 405 Method Not Allowed\r\n"), "{method}: {answer}");
        assert!(answer.contains("\r\nAllow: GET\r\n"), "{method}");
    }
    // However long a body is said to be, no memory is set aside for it.
    for length in ["3", "1000000000000000", "99999999999999999999999", "-1", "x"] {
        let request = |method| {
            format!("{method} / HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n\r\nabc")
        };
        assert!(message(live.address(), request("POST").as_bytes()).starts_with("HTTP/1.1 405"));
        assert!(message(live.address(), request("GET").as_bytes()).starts_with("HTTP/1.1 413"));
    }
    let chunked = b"GET / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n";
    assert!(message(live.address(), chunked).starts_with("HTTP/1.1 413"));
}

#[test]
fn a_name_that_is_not_of_this_machine_is_forbidden() {
    let live = live();
    for host in ["127.0.0.1", "127.0.0.1:80", "localhost", "LocalHost:65535", "localhost:"] {
        let answer = with_host(&live, &format!("Host: {host}\r\n"));
        assert!(answer.starts_with("HTTP/1.1 200"), "{host}: {answer}");
    }
    for lines in [
        "Host: example.org\r\n",
        "Host: localhost.example.org\r\n",
        "Host: 127.0.0.1.example.org:80\r\n",
        "Host: 127.0.0.1:80@example.org\r\n",
        "Host: 0.0.0.0\r\n",
        "Host: \r\n",
        "",
        "Host: localhost\r\nHost: example.org\r\n",
        "Host: example.org\r\nHost: localhost\r\n",
    ] {
        let answer = with_host(&live, lines);
        assert!(answer.starts_with("HTTP/1.1 403 Forbidden\r\n"), "{lines:?}: {answer}");
    }
}

#[test]
fn long_heads_and_no_requests_at_all_are_refused() {
    let live = live();
    let long = format!("GET /{} HTTP/1.1\r\nHost: localhost\r\n\r\n", "x".repeat(100_000));
    assert!(message(live.address(), long.as_bytes()).starts_with("HTTP/1.1 431"));
    let many = "a: b\r\n".repeat(100);
    assert!(with_host(&live, &format!("Host: localhost\r\n{many}")).starts_with("HTTP/1.1 431"));
    for bytes in [&b"\0\xff\xfe\r\n\r\n"[..], b"GET\r\n\r\n", b"GET / HTTP/9\r\n\r\n"] {
        assert!(message(live.address(), bytes).starts_with("HTTP/1.1 400"), "{bytes:?}");
    }
}

#[test]
fn a_state_that_is_known_is_not_sent_again_and_versions_grow() {
    let live = live();
    let first = version(&get(&live, "/state.json"));
    let again = format!("/state.json?after={first}");
    assert!(get(&live, &again).starts_with("HTTP/1.1 204 No Content\r\n"));
    live.publish(Snapshot { step: 8, ..Snapshot::default() });
    let answer = get(&live, &again);
    assert!(answer.contains("\"step\":8") && version(&answer) > first, "{answer}");
}

#[test]
fn a_browser_that_reads_nothing_keeps_neither_the_fit_nor_others_waiting() {
    let live = live();
    let large: Vec<u8> = vec![b' '; 50 << 20];
    live.publish(Snapshot { mesh: Some(large.into()), ..Snapshot::default() });
    let mut slow = TcpStream::connect(live.address()).expect("a connection");
    slow.write_all(b"GET /mesh.json HTTP/1.1\r\nHost: localhost\r\n\r\n").expect("it is taken");
    let _idle = TcpStream::connect(live.address()).expect("a connection");
    let begun = Instant::now();
    for step in 0..100 {
        live.publish(Snapshot { step, ..Snapshot::default() });
    }
    assert!(get(&live, "/state.json").contains("\"step\":99"));
    assert!(begun.elapsed() < Duration::from_secs(4), "{:?}", begun.elapsed());
}

#[test]
fn a_dropped_page_leaves_its_port_and_does_not_wait_for_clients() {
    let live = live();
    let address = live.address();
    let _idle = TcpStream::connect(address).expect("a connection");
    let begun = Instant::now();
    drop(live);
    assert!(begun.elapsed() < Duration::from_secs(4), "{:?}", begun.elapsed());
    assert!(TcpStream::connect(address).is_err(), "it still listens");
}

#[test]
fn a_port_that_is_taken_is_an_error() {
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = taken.local_addr().expect("an address").port();
    assert!(Live::start(port).is_err());
    let live = Live::start(0).expect("a port");
    assert!(live.address().ip().is_loopback());
    assert_eq!(live.url(), format!("http://127.0.0.1:{}/", live.address().port()));
}
