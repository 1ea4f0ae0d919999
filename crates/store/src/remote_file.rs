//! A file behind a URL, read in blocks that grow with sequential reading, and one block ahead.

use std::io::{self, Read, Seek, SeekFrom};
use std::sync::Arc;

use reactsim_files::RemoteFile;

use super::blocks::{BLOCK, MAX_KEPT};
use super::client::{FileInfo, HelperStore, Part};
use super::connection::Pending;

/// Factor by which blocks grow.
const GROWTH: u64 = 4;
/// Maximum length of a block in bytes. An open file holds two of them at most: the current one, and the one
/// that is read ahead.
const MAX_BLOCK: u64 = 8 << 20;

/// An open file behind a URL.
pub(crate) struct BlockReader {
    store: &'static HelperStore,
    url: Arc<str>,
    info: FileInfo,
    position: u64,
    /// Offset of the current block, and its bytes.
    start: u64,
    block: Arc<Vec<u8>>,
    /// Length of the next block of sequential reading.
    next_length: u64,
    ahead: Option<(Part, Pending)>,
    /// Whether size and version were compared since the file was opened.
    is_checked: bool,
}

impl BlockReader {
    /// Opens a file.
    ///
    /// # Errors
    /// If there is no such file, or it cannot be read.
    pub(crate) fn open(store: &'static HelperStore, url: &str) -> io::Result<Self> {
        Ok(Self {
            store,
            url: url.into(),
            info: store.info(url)?,
            position: 0,
            start: 0,
            block: Arc::default(),
            next_length: MAX_KEPT,
            ahead: None,
            is_checked: false,
        })
    }

    fn end(&self) -> u64 {
        self.start + self.block.len() as u64
    }

    /// Makes the block with the current position, which is within the file, the current one.
    fn load(&mut self) -> io::Result<()> {
        let is_sequential = self.position == self.end() && !self.block.is_empty();
        let ahead = self.ahead.take().filter(|(part, _)| part.contains(self.position));
        if let Some((part, pending)) = ahead {
            let content = self.store.finish(&self.url, &self.info, part, pending)?;
            self.set(part.start, Arc::new(content));
        } else {
            if !is_sequential {
                self.next_length = MAX_KEPT;
            }
            let known = self.store.blocks.lock().find(&self.url, self.position);
            if let Some((start, block)) = known {
                self.set(start, block);
                return Ok(());
            }
            let part = if is_sequential { self.next_part(self.position) } else { self.single_part() };
            let block = Arc::new(self.store.read(&self.url, &self.info, part)?);
            // Others who open this file, or this reader again, need the same header and footer.
            self.store.blocks.lock().add(Arc::clone(&self.url), part.start, Arc::clone(&block));
            self.set(part.start, block);
            if !is_sequential {
                return Ok(());
            }
        }
        // Sequential reading: the next block arrives while this one is used.
        if self.end() < self.info.size {
            let part = self.next_part(self.end());
            self.ahead = self.store.read_ahead(&self.url, &self.info, part).map(|pending| (part, pending));
        }
        Ok(())
    }

    /// Returns the small part with the current position, as for a header or a footer.
    fn single_part(&self) -> Part {
        let start = self.position / BLOCK * BLOCK;
        let length = BLOCK.min(self.info.size - start);
        Part { start, length, is_checked: start + length == self.info.size }
    }

    fn set(&mut self, start: u64, block: Arc<Vec<u8>>) {
        (self.start, self.block) = (start, block);
    }

    /// Returns the next part of sequential reading. The first and the last one are checked for changes.
    fn next_part(&mut self, start: u64) -> Part {
        let length = self.next_length.min(self.info.size - start);
        self.next_length = (self.next_length * GROWTH).min(MAX_BLOCK);
        let is_checked = !self.is_checked || start + length == self.info.size;
        self.is_checked = true;
        Part { start, length, is_checked }
    }
}

impl Part {
    fn contains(self, position: u64) -> bool {
        (self.start..self.start + self.length).contains(&position)
    }
}

impl RemoteFile for BlockReader {
    fn size(&self) -> u64 {
        self.info.size
    }
}

impl Read for BlockReader {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() || self.position >= self.info.size {
            return Ok(0);
        }
        if !(self.start..self.end()).contains(&self.position) {
            self.load()?;
        }
        let rest = &self.block[(self.position - self.start) as usize..];
        let count = rest.len().min(buffer.len());
        buffer[..count].copy_from_slice(&rest[..count]);
        self.position += count as u64;
        Ok(count)
    }
}

impl Seek for BlockReader {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let position = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::End(offset) => self.info.size.checked_add_signed(offset),
            SeekFrom::Current(offset) => self.position.checked_add_signed(offset),
        };
        self.position = position.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.position)
    }
}

#[cfg(test)]
mod tests {
    use std::process::Command;
    use std::time::Duration;

    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};
    use reactsim_test_support::skipped;

    use super::super::command::HelperCommand;
    use super::*;

    /// Helper with one file of 40 MB, of which the word at every fourth byte is its own number.
    const HELPER: &str = "
import struct, sys
size, out = 40_000_003, sys.stdout.buffer
content = b''.join(struct.pack('<I', i) for i in range(size // 4 + 1))[:size]
out.write(b'reactsim-store 1\\n')
out.flush()
for line in sys.stdin:
    request, verb, url, *part = line.rstrip('\\n').split('\\t')
    answer = b'%d\\tv1' % size
    if verb == 'read':
        answer = content[int(part[0]) : int(part[0]) + int(part[1])]
        assert part[2:] in (['', ''], [str(size), 'v1'])
    out.write(b'%s\\tok\\t%d\\n' % (request.encode(), len(answer)) + answer)
    out.flush()
";

    fn byte(position: u64) -> u8 {
        ((position / 4) as u32).to_le_bytes()[(position % 4) as usize]
    }

    #[test]
    fn any_order_of_reading_gives_the_bytes_of_the_file() {
        if !Command::new("python3").arg("--version").output().is_ok_and(|o| o.status.success()) {
            return skipped("no python3");
        }
        let command = HelperCommand::new(["python3", "-c", HELPER].map(str::to_owned).to_vec());
        let store: &'static HelperStore =
            Box::leak(Box::new(HelperStore::new(command, Duration::from_secs(60))));
        let mut file = BlockReader::open(store, "x://a").unwrap();
        let size = file.size();
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let mut buffer = vec![0; 3 << 20];
        for _ in 0..60 {
            let start = match random.next_u32() % 4 {
                0 => file.seek(SeekFrom::Start(u64::from(random.next_u32()) % (size + 10))).unwrap(),
                1 => file.seek(SeekFrom::End(-i64::from(random.next_u32() % 100_000))).unwrap(),
                _ => file.stream_position().unwrap(),
            };
            let length = (random.next_u32() as usize % buffer.len()) >> (random.next_u32() % 20);
            let mut found = 0;
            while found < length {
                let count = file.read(&mut buffer[found..length]).unwrap();
                if count == 0 {
                    break;
                }
                found += count;
            }
            assert_eq!(found as u64, (length as u64).min(size.saturating_sub(start)));
            for (i, found) in buffer[..found].iter().enumerate() {
                assert_eq!(*found, byte(start + i as u64), "byte {i} from {start} on");
            }
        }
        assert!(file.seek(SeekFrom::Current(-i64::MAX)).is_err());
    }
}
