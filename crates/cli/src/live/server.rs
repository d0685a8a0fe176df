//! The server: a few paths, to readers on this machine, one request a connection.
//!
//! What is refused: other methods than GET, bodies, heads of more than 16 KiB, a `Host` other than
//! 127.0.0.1 or localhost (a foreign name that was made to lead here: DNS rebinding), and clients that
//! are slow or too many. The port in `Host` is not compared: a tunnel may end at another.

use std::io::{self, ErrorKind, Read as _, Write as _};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use super::state::{Published, Shared};

/// The longest head of a request, in bytes, and the most of its headers. Browsers send the cookies of
/// all servers on localhost along, whatever their ports.
const MOST_HEAD: usize = 16 << 10;
const MOST_HEADERS: usize = 64;
/// More connections at once are closed unanswered.
const MOST_CONNECTIONS: usize = 32;
/// How long a request may take to come, and an answer to go.
const TO_READ: Duration = Duration::from_secs(5);
const TO_WRITE: Duration = Duration::from_secs(30);
/// How much of a refused request is read, and how long, so that its sender sees the answer.
const TO_DRAIN: Duration = Duration::from_millis(500);
const MOST_DRAINED: usize = 256 << 10;

/// Beside each answer: it is kept nowhere, and used by no other origin.
const HEADERS: &str = "Connection: close\r\nCache-Control: no-store\r\n\
    X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
    Cross-Origin-Resource-Policy: same-origin\r\nX-Frame-Options: DENY\r\n\
    Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; \
    img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; \
    frame-ancestors 'none'\r\n";

const PAGE: &str = include_str!("page.html");
const PAGE_SCRIPT: &str = include_str!("page.js");
const PAGE_STYLE: &str = include_str!("page.css");

/// Where a server listens, and whether it goes on.
#[derive(Debug)]
pub(super) struct Server {
    address: SocketAddr,
    stopped: AtomicBool,
    connections: AtomicUsize,
}

/// What a request is answered with.
struct Answer {
    status: &'static str,
    kind: &'static str,
    body: Arc<[u8]>,
}

impl Answer {
    fn ok(kind: &'static str, body: impl Into<Arc<[u8]>>) -> Self {
        Self { status: "200 OK", kind, body: body.into() }
    }

    /// A refusal: its status is its text.
    fn refused(status: &'static str) -> Self {
        let kind = "text/plain; charset=utf-8";
        Self { status, kind, body: format!("{status}\n").into_bytes().into() }
    }
}

impl Server {
    pub(super) fn new(address: SocketAddr) -> Self {
        let (stopped, connections) = (AtomicBool::new(false), AtomicUsize::new(0));
        Self { address, stopped, connections }
    }

    pub(super) fn address(&self) -> SocketAddr {
        self.address
    }

    /// Answers until [`stop`](Self::stop). Each connection has a thread of its own, which ends within
    /// the times above: browsers open some that they do not use.
    pub(super) fn serve(self: &Arc<Self>, listener: &TcpListener, shared: &Arc<Shared>) {
        for connection in listener.incoming() {
            if self.stopped.load(Ordering::Acquire) {
                return;
            }
            let Ok(stream) = connection else {
                // No descriptor is free, or a client went away.
                thread::sleep(Duration::from_millis(50));
                continue;
            };
            if self.connections.fetch_add(1, Ordering::AcqRel) >= MOST_CONNECTIONS {
                self.connections.fetch_sub(1, Ordering::AcqRel);
                continue;
            }
            let (server, shared) = (Arc::clone(self), Arc::clone(shared));
            let named = thread::Builder::new().name("live page".to_owned());
            let spawned = named.spawn(move || {
                // A client that goes away is no matter.
                let _ = answer(&stream, &shared);
                server.connections.fetch_sub(1, Ordering::AcqRel);
            });
            if spawned.is_err() {
                self.connections.fetch_sub(1, Ordering::AcqRel);
            }
        }
    }

    /// Ends [`serve`](Self::serve). Whether it was woken.
    pub(super) fn stop(&self) -> bool {
        self.stopped.store(true, Ordering::Release);
        TcpStream::connect_timeout(&self.address, Duration::from_secs(1)).is_ok()
    }
}

/// Reads a request and answers it.
fn answer(stream: &TcpStream, shared: &Shared) -> io::Result<()> {
    let (answer, whole) = match read_head(stream)? {
        Some(head) => answer_to(&head, shared),
        None => (Answer::refused("431 Request Header Fields Too Large"), false),
    };
    let Answer { status, kind, body } = answer;
    let of_status = match &status[..3] {
        "204" => String::new(),
        "405" => format!("Allow: GET\r\n{}", of_body(kind, body.len())),
        _ => of_body(kind, body.len()),
    };
    let head = format!("HTTP/1.1 {status}\r\n{of_status}{HEADERS}\r\n");
    let end = Instant::now() + TO_WRITE;
    for part in [head.as_bytes(), &body] {
        write_until(stream, part, end)?;
    }
    stream.shutdown(Shutdown::Write)?;
    // What lies unread when a connection is closed would take the answer away from its reader.
    if whole { Ok(()) } else { drain(stream) }
}

fn of_body(kind: &str, length: usize) -> String {
    format!("Content-Type: {kind}\r\nContent-Length: {length}\r\n")
}

/// A request up to its empty line; `None` where that does not come within [`MOST_HEAD`] bytes.
fn read_head(mut stream: &TcpStream) -> io::Result<Option<Vec<u8>>> {
    let end = Instant::now() + TO_READ;
    let (mut head, mut piece) = (Vec::new(), [0; 1024]);
    while head.len() < MOST_HEAD {
        stream.set_read_timeout(Some(left(end)?))?;
        let count = stream.read(&mut piece)?;
        if count == 0 {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        // The empty line may begin in the piece before.
        let from = head.len().saturating_sub(3);
        head.extend_from_slice(&piece[..count]);
        if head[from..].windows(4).any(|four| four == b"\r\n\r\n") {
            return Ok(Some(head));
        }
    }
    Ok(None)
}

/// Writes all of `bytes`, in pieces: a reader that takes a byte at a time would else have no end.
fn write_until(mut stream: &TcpStream, bytes: &[u8], end: Instant) -> io::Result<()> {
    let mut rest = bytes;
    while !rest.is_empty() {
        stream.set_write_timeout(Some(left(end)?))?;
        match stream.write(rest)? {
            0 => return Err(ErrorKind::WriteZero.into()),
            count => rest = &rest[count..],
        }
    }
    Ok(())
}

fn drain(mut stream: &TcpStream) -> io::Result<()> {
    let end = Instant::now() + TO_DRAIN;
    let (mut drained, mut piece) = (0, [0; 4096]);
    while drained < MOST_DRAINED {
        stream.set_read_timeout(Some(left(end)?))?;
        match stream.read(&mut piece)? {
            0 => break,
            count => drained += count,
        }
    }
    Ok(())
}

/// The time until `end`, which is more than none.
fn left(end: Instant) -> io::Result<Duration> {
    let left = end.saturating_duration_since(Instant::now());
    if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(left) }
}

/// The answer to a request, and whether `head` is all of the request.
fn answer_to(head: &[u8], shared: &Shared) -> (Answer, bool) {
    let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
    let mut request = httparse::Request::new(&mut headers);
    let length = match request.parse(head) {
        Ok(httparse::Status::Complete(length)) => length,
        Err(httparse::Error::TooManyHeaders) => {
            return (Answer::refused("431 Request Header Fields Too Large"), false);
        }
        _ => return (Answer::refused("400 Bad Request"), false),
    };
    let named = |name: &'static str| {
        let headers = request.headers.iter();
        headers.filter(move |header| header.name.eq_ignore_ascii_case(name))
    };
    let mut hosts = named("Host");
    let is_ours = hosts.next().is_some_and(|host| is_own(host.value)) && hosts.next().is_none();
    let has_body = named("Transfer-Encoding").next().is_some()
        || named("Content-Length").any(|length| length.value != b"0");
    let whole = length == head.len() && !has_body;
    let answer = match (request.method, request.path) {
        _ if !is_ours => Answer::refused("403 Forbidden"),
        (Some("GET"), _) if has_body => Answer::refused("413 Content Too Large"),
        (Some("GET"), Some(target)) => page(target, &shared.now()),
        _ => Answer::refused("405 Method Not Allowed"),
    };
    (answer, whole)
}

/// Whether a request with this `Host` was meant for this machine.
fn is_own(host: &[u8]) -> bool {
    let Ok(host) = std::str::from_utf8(host) else { return false };
    let name = match host.split_once(':') {
        Some((name, port)) if port.bytes().all(|digit| digit.is_ascii_digit()) => name,
        Some(_) => return false,
        None => host,
    };
    name == Ipv4Addr::LOCALHOST.to_string() || name.eq_ignore_ascii_case("localhost")
}

/// What stands at a path.
fn page(target: &str, now: &Published) -> Answer {
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let answer = match path {
        "/" => Some(Answer::ok("text/html; charset=utf-8", PAGE.as_bytes())),
        "/page.js" => Some(script(PAGE_SCRIPT)),
        "/viewer.js" => Some(script(bokashi_report::VIEWER_SCRIPT)),
        "/page.css" => {
            let style = format!("{}{PAGE_STYLE}", bokashi_report::style());
            Some(Answer::ok("text/css; charset=utf-8", style.into_bytes()))
        }
        "/state.json" => Some(state(query, now)),
        "/mesh.json" => now.mesh().map(|mesh| Answer::ok("application/json", mesh)),
        _ => picture(path, now),
    };
    answer.unwrap_or_else(|| Answer::refused("404 Not Found"))
}

fn script(text: &str) -> Answer {
    Answer::ok("text/javascript; charset=utf-8", text.as_bytes())
}

/// The state, or nothing where `after=` names its version.
fn state(query: &str, now: &Published) -> Answer {
    let known = query.split('&').find_map(|pair| pair.strip_prefix("after="));
    let kind = "application/json";
    if known.and_then(|known| known.parse().ok()) == Some(now.version()) {
        return Answer { status: "204 No Content", kind, body: Arc::new([]) };
    }
    Answer::ok(kind, now.json().into_bytes())
}

/// `/view/3/target.png` is the target of the fourth view.
fn picture(path: &str, now: &Published) -> Option<Answer> {
    let (index, file) = path.strip_prefix("/view/")?.split_once('/')?;
    let file = now.picture(index.parse().ok()?, file.strip_suffix(".png")?)?;
    Some(Answer::ok("image/png", file))
}
