//! Files behind URLs: S3, Google Cloud Storage, Azure and web servers.
//!
//! The clients take credentials and endpoints from the environment, and repeat requests that may yet succeed.

use std::collections::{BTreeMap, VecDeque};
use std::env;
use std::future::Future;
use std::io::{self, ErrorKind, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Arc, LazyLock, mpsc};

use bytes::Bytes;
use futures_util::TryStreamExt;
use object_store::http::HttpBuilder;
use object_store::path::Path;
use object_store::{ClientConfigKey, Error, GetOptions, ObjectMeta, ObjectStore, parse_url_opts};
use parking_lot::Mutex;
use tokio::runtime::{Builder, Runtime};
use url::{Position, Url};

/// Length in bytes of a block after a jump, and of the start of a file, which is read when it is opened.
const BLOCK: u64 = 1 << 16;
/// Factor by which blocks grow while a file is read in order.
const GROWTH: u64 = 4;
/// Maximum length of a block in bytes. An open file holds two: the current one and the next one.
const MAX_BLOCK: u64 = 8 << 20;
/// Number of starts of files that are kept: formats are recognised by them, one after the other.
const MAX_STARTS: usize = 64;
/// Time within which a block must arrive.
const TIMEOUT: &str = "120s";
const CHANGED: &str = "it was changed since this program opened it; start again when it is complete";

/// Stores by host, and files that were opened or cannot be: every format would try again.
#[derive(Default)]
struct Known {
    stores: BTreeMap<String, Arc<dyn ObjectStore>>,
    files: BTreeMap<String, Result<ObjectMeta, (ErrorKind, String)>>,
    starts: VecDeque<(String, Bytes)>,
}

static KNOWN: LazyLock<Mutex<Known>> = LazyLock::new(Mutex::default);
static RUNTIME: LazyLock<io::Result<Runtime>> =
    LazyLock::new(|| Builder::new_multi_thread().worker_threads(1).enable_all().build());

type Pending<T = (ObjectMeta, Bytes)> = mpsc::Receiver<io::Result<T>>;

/// An open file behind a URL.
pub struct RemoteFile {
    store: Arc<dyn ObjectStore>,
    pub(super) meta: ObjectMeta,
    position: u64,
    /// Offset of the current block, and its bytes.
    start: u64,
    block: Bytes,
    /// Length of the last block, bytes.
    length: u64,
    ahead: Option<(Range<u64>, Pending)>,
}

pub(super) fn open(url: &str) -> io::Result<RemoteFile> {
    let (store, path, _) = locate(url)?;
    let known = KNOWN.lock().files.get(url).cloned();
    let meta = known.unwrap_or_else(|| {
        let start = GetOptions::new().with_range(Some(0..BLOCK));
        let found = request(&store, &path, start).and_then(wait).map_err(|e| (e.kind(), e.to_string()));
        let mut known = KNOWN.lock();
        let meta = found.map(|(meta, start)| {
            known.starts.truncate(MAX_STARTS - 1);
            known.starts.push_front((url.to_owned(), start));
            meta
        });
        known.files.insert(url.to_owned(), meta.clone());
        meta
    });
    let meta = meta.map_err(|(kind, text)| io::Error::new(kind, text))?;
    let block = KNOWN.lock().starts.iter().find(|(of, _)| of == url).map_or_else(Bytes::new, |s| s.1.clone());
    Ok(RemoteFile { store, meta, position: 0, start: 0, block, length: BLOCK, ahead: None })
}

/// Returns the URL of the file at a URL, or the URLs of all files below it, in any order.
pub(super) fn list(url: &str) -> io::Result<Vec<PathBuf>> {
    let (store, path, parsed) = locate(url)?;
    // Web servers do not list folders.
    let is_web = parsed.scheme().starts_with("http");
    if is_web || !url.ends_with('/') {
        match open(url) {
            Ok(_) => return Ok(vec![url.into()]),
            Err(e) if is_web || e.kind() != ErrorKind::NotFound => return Err(e),
            Err(_) => {}
        }
    }
    let found = spawn(async move { store.list(Some(&path)).try_collect::<Vec<_>>().await.map_err(explain) });
    let found = wait(found?)?;
    if found.is_empty() {
        let text = "there is no such file, and no file below it; check the URL";
        return Err(io::Error::new(ErrorKind::NotFound, text));
    }
    let encoded = |path: &Path| path.as_ref().replace('%', "%25").replace('?', "%3F").replace('#', "%23");
    let base = &parsed[..Position::BeforePath];
    Ok(found.iter().map(|file| format!("{base}/{}", encoded(&file.location)).into()).collect())
}

/// Returns the store of a URL, the path in it, and the URL.
fn locate(text: &str) -> io::Result<(Arc<dyn ObjectStore>, Path, Url)> {
    let url = Url::parse(text).map_err(|e| io::Error::new(ErrorKind::InvalidInput, e))?;
    // The parser passes over control characters, and cuts names of objects at these marks.
    if text.contains(char::is_control) || (!url.scheme().starts_with("http") && text.contains(['?', '#'])) {
        let text = "write `%3F` for `?`, `%23` for `#`, and no control characters";
        return Err(io::Error::new(ErrorKind::InvalidInput, text));
    }
    let path = Path::from_url_path(url.path()).map_err(|e| explain(e.into()))?;
    rustls::crypto::ring::default_provider().install_default().ok();
    // The query of a web address may be its credentials.
    let key = format!("{}?{}", &url[..Position::BeforePath], url.query().unwrap_or_default());
    if let Some(store) = KNOWN.lock().stores.get(&key) {
        return Ok((Arc::clone(store), path, url));
    }
    let store: Arc<dyn ObjectStore> = match url.scheme() {
        "s3" | "s3a" | "gs" | "az" | "azure" | "abfs" | "abfss" => {
            let settings = env::vars_os().filter_map(|(key, value)| {
                let (key, value) = (key.to_str()?.to_owned(), value.to_str()?.to_owned());
                ["AWS_", "GOOGLE_", "AZURE_"].iter().any(|p| key.starts_with(p)).then_some((key, value))
            });
            let settings = settings.chain([("timeout".to_owned(), TIMEOUT.to_owned())]);
            parse_url_opts(&url, settings).map_err(explain)?.0.into()
        }
        "http" | "https" => {
            let mut base = url.clone();
            base.set_path("");
            let store = HttpBuilder::new().with_url(base).with_config(ClientConfigKey::AllowHttp, "true");
            Arc::new(store.with_config(ClientConfigKey::Timeout, TIMEOUT).build().map_err(explain)?)
        }
        other => {
            let text = format!("`{other}://` is not read, only s3, gs, az and https: download it first");
            return Err(io::Error::new(ErrorKind::Unsupported, text));
        }
    };
    KNOWN.lock().stores.insert(key, Arc::clone(&store));
    Ok((store, path, url))
}

/// Begins a request for a part of a file.
fn request(store: &Arc<dyn ObjectStore>, path: &Path, options: GetOptions) -> io::Result<Pending> {
    let (store, path) = (Arc::clone(store), path.clone());
    spawn(async move {
        let found = store.get_opts(&path, options).await.map_err(explain)?;
        Ok((found.meta.clone(), found.bytes().await.map_err(explain)?))
    })
}

/// Runs a task on a thread for all requests. Callers may be tasks of other runtimes.
fn spawn<T: Send + 'static>(
    task: impl Future<Output = io::Result<T>> + Send + 'static,
) -> io::Result<Pending<T>> {
    let runtime = RUNTIME.as_ref().map_err(|e| io::Error::new(e.kind(), e.to_string()))?;
    let (send, receive) = mpsc::sync_channel(1);
    runtime.spawn(async move { send.send(task.await).ok() });
    Ok(receive)
}

fn wait<T>(pending: Pending<T>) -> io::Result<T> {
    pending.recv().map_err(io::Error::other)?
}

/// Returns an error of a store with a remedy, on one line.
fn explain(found: Error) -> io::Error {
    let (kind, remedy) = match &found {
        Error::NotFound { .. } => (ErrorKind::NotFound, "check the URL"),
        Error::PermissionDenied { .. } | Error::Unauthenticated { .. } => {
            (ErrorKind::PermissionDenied, "check the credentials and the permissions of this URL")
        }
        Error::Precondition { .. } => (ErrorKind::InvalidData, CHANGED),
        _ => (ErrorKind::Other, "check the connection and the URL, or download the file first"),
    };
    let text: String = found.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    io::Error::new(kind, format!("{}; {remedy}", text.chars().take(500).collect::<String>()))
}

impl RemoteFile {
    /// Makes the block with the current position, which is within the file, the current one.
    fn load(&mut self) -> io::Result<()> {
        let end = self.start + self.block.len() as u64;
        let is_sequential = self.position == end && !self.block.is_empty();
        let ahead = self.ahead.take().filter(|(range, _)| range.contains(&self.position));
        let (start, block) = if let Some((range, pending)) = ahead {
            (range.start, self.finish(pending, &range)?)
        } else {
            // Headers and footers are small.
            self.length = if is_sequential { self.length } else { BLOCK / GROWTH };
            let start = if is_sequential { self.position } else { self.position / BLOCK * BLOCK };
            let (range, pending) = self.request_from(start)?;
            (start, self.finish(pending, &range)?)
        };
        (self.start, self.block) = (start, block);
        // The next block arrives while this one is used.
        let end = start + self.block.len() as u64;
        if is_sequential && end < self.meta.size {
            self.ahead = Some(self.request_from(end)?);
        }
        Ok(())
    }

    /// Requests a longer block than the last one. The file must be the one that was opened.
    fn request_from(&mut self, start: u64) -> io::Result<(Range<u64>, Pending)> {
        self.length = (self.length * GROWTH).min(MAX_BLOCK);
        let range = start..(start + self.length).min(self.meta.size);
        let tag = self.meta.e_tag.clone().filter(|tag| !tag.starts_with("W/"));
        let time = Some(self.meta.last_modified).filter(|time| tag.is_none() && time.timestamp() > 0);
        let options = GetOptions::new().with_range(Some(range.clone()));
        let options = options.with_if_match(tag).with_if_unmodified_since(time);
        Ok((range, request(&self.store, &self.meta.location, options)?))
    }

    fn finish(&self, pending: Pending, range: &Range<u64>) -> io::Result<Bytes> {
        let (meta, bytes) = wait(pending)?;
        let is_same = meta.size == self.meta.size && bytes.len() as u64 == range.end - range.start;
        if is_same { Ok(bytes) } else { Err(io::Error::new(ErrorKind::InvalidData, CHANGED)) }
    }
}

impl Read for RemoteFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() || self.position >= self.meta.size {
            return Ok(0);
        }
        if !(self.start..self.start + self.block.len() as u64).contains(&self.position) {
            self.load()?;
        }
        let count = (&self.block[(self.position - self.start) as usize..]).read(buffer)?;
        self.position += count as u64;
        Ok(count)
    }
}

impl Seek for RemoteFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let position = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::End(offset) => self.meta.size.checked_add_signed(offset),
            SeekFrom::Current(offset) => self.position.checked_add_signed(offset),
        };
        self.position = position.ok_or(ErrorKind::InvalidInput)?;
        Ok(self.position)
    }
}

#[cfg(test)]
mod tests;
