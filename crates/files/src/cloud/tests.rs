use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use super::*;
use crate::{list_url, open_regular};

const SIZE: u64 = 21_000_003;

/// Requests answered so far, of all tests.
static REQUESTS: AtomicUsize = AtomicUsize::new(0);

fn byte(position: u64) -> u8 {
    ((position / 4) as u32).to_le_bytes()[(position % 4) as usize]
}

/// Starts a web server with the file `/file name?key=k`, and `/changing`, whose tag changes after its first
/// block. Returns its address.
fn server() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    thread::spawn(move || {
        for stream in listener.incoming() {
            thread::spawn(move || answer(stream.unwrap()));
        }
    });
    address
}

fn answer(stream: TcpStream) {
    let mut lines = BufReader::new(stream.try_clone().unwrap()).lines();
    loop {
        let head: Vec<String> =
            lines.by_ref().map_while(Result::ok).take_while(|line| !line.is_empty()).collect();
        let Some(first) = head.first() else { return };
        REQUESTS.fetch_add(1, Ordering::Relaxed);
        let header = |name: &str| {
            let found =
                head.iter().find_map(|line| line.to_lowercase().strip_prefix(name).map(str::to_owned));
            found.map(|value| value.trim().to_owned())
        };
        let range = header("range: bytes=").unwrap();
        let (start, end) = range.split_once('-').unwrap();
        let (start, end) = (start.parse::<u64>().unwrap(), end.parse::<u64>().unwrap().min(SIZE - 1));
        let tag = match first.split(' ').nth(1).unwrap() {
            "/changing" if start > 0 => "\"2\"",
            "/changing" | "/file%20name?key=k" => "\"1\"",
            _ => {
                (&stream).write_all(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n").unwrap();
                continue;
            }
        };
        if header("if-match:").is_some_and(|expected| expected != tag) {
            (&stream).write_all(b"HTTP/1.1 412 Changed\r\nContent-Length: 0\r\n\r\n").unwrap();
            continue;
        }
        let content: Vec<u8> = (start..=end).map(byte).collect();
        let head = format!(
            "HTTP/1.1 206 Part\r\nETag: {tag}\r\nContent-Length: {}\r\n\
             Content-Range: bytes {start}-{end}/{SIZE}\r\n\r\n",
            content.len()
        );
        if (&stream).write_all(head.as_bytes()).and_then(|()| (&stream).write_all(&content)).is_err() {
            return;
        }
    }
}

#[test]
fn any_order_of_reading_gives_the_bytes_of_the_file() {
    let url = format!("{}/file name?key=k", server());
    assert_eq!(list_url(&url).unwrap(), [Path::new(&url)]);
    let mut file = open_regular(Path::new(&url)).unwrap();
    assert_eq!(file.size().unwrap(), SIZE);
    let mut random = 7_u64;
    let mut next = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        random >> 33
    };
    let mut buffer = vec![0; 3 << 20];
    for _ in 0..60 {
        let start = match next() % 4 {
            0 => file.seek(SeekFrom::Start(next() % (SIZE + 10))).unwrap(),
            1 => file.seek(SeekFrom::End(-((next() % 100_000) as i64))).unwrap(),
            _ => file.stream_position().unwrap(),
        };
        let length = (next() as usize % buffer.len()) >> (next() % 20);
        let mut part = Vec::new();
        file.by_ref().take(length as u64).read_to_end(&mut part).unwrap();
        assert_eq!(part.len() as u64, (length as u64).min(SIZE.saturating_sub(start)));
        buffer[..part.len()].copy_from_slice(&part);
        assert!(
            (start..).zip(&part).all(|(position, found)| byte(position) == *found),
            "{length} from {start}"
        );
    }
    assert!(file.seek(SeekFrom::Current(-i64::MAX)).is_err());
}

#[test]
fn a_file_that_changes_is_refused() {
    let url = format!("{}/changing", server());
    let mut file = open_regular(Path::new(&url)).unwrap();
    let error = file.read_to_end(&mut Vec::new()).unwrap_err();
    assert!(
        error.kind() == ErrorKind::InvalidData && error.to_string().contains("it was changed"),
        "{error}"
    );
}

#[test]
fn what_cannot_be_read_is_named() {
    let missing = format!("{}/none", server());
    for (url, kind, part) in [
        (missing.as_str(), ErrorKind::NotFound, "check the URL"),
        ("hf://datasets/a", ErrorKind::Unsupported, "`hf://` is not read"),
        ("s3://bucket/a\tb", ErrorKind::InvalidInput, "no control characters"),
        ("gs://bucket/a?b", ErrorKind::InvalidInput, "`%3F`"),
        ("s3://bucket/../b//c", ErrorKind::Other, "path"),
    ] {
        for error in [open(url).map(drop).unwrap_err(), list(url).map(drop).unwrap_err()] {
            let text = error.to_string();
            assert!(error.kind() == kind && text.contains(part) && !text.contains('\n'), "{url}: {text}");
        }
    }
    let before = REQUESTS.load(Ordering::Relaxed);
    assert!(open(&missing).is_err());
    assert_eq!(REQUESTS.load(Ordering::Relaxed), before, "a failure is not tried again");
}
