//! Archives of PyTorch: ZIP files, without compression, of a pickle and the storages of its tensors.

use std::collections::BTreeMap;
use std::ops::Range;

/// First bytes of ZIP files.
const MAGIC: &[u8] = b"PK\x03\x04";
/// First bytes of the end of the list of parts.
const END: &[u8] = b"PK\x05\x06";
/// Length in bytes of an entry of the list of parts, without its name.
const ENTRY: usize = 46;
/// Length in bytes of the header before a part, without its name.
const HEADER: usize = 30;

pub(super) fn is_archive(file: &[u8]) -> bool {
    file.starts_with(MAGIC)
}

/// The place of the pickle in a file, and those of the storages by key.
pub(super) type Parts = (Range<usize>, BTreeMap<String, Range<u32>>);

/// Returns the places of the parts of an archive.
pub(super) fn parts(file: &[u8]) -> Result<Parts, String> {
    let cut = || "the list of its parts is missing: the file is cut; fetch it again".to_owned();
    let number = |at: usize, bytes: usize| -> Result<usize, String> {
        let field = file.get(at..at + bytes).ok_or_else(cut)?;
        Ok(field.iter().rev().fold(0, |all, byte| (all << 8) | usize::from(*byte)))
    };
    let end = file.windows(END.len()).rposition(|w| w == END).ok_or_else(cut)?;
    let (mut pickle, mut storages) = (None, BTreeMap::new());
    let mut at = number(end + 16, 4)?;
    for _ in 0..number(end + 10, 2)? {
        let length = number(at + 28, 2)?;
        let name = file.get(at + ENTRY..at + ENTRY + length).ok_or_else(cut)?;
        let name = String::from_utf8_lossy(name).into_owned();
        let (method, size, header) = (number(at + 10, 2)?, number(at + 24, 4)?, number(at + 42, 4)?);
        at += ENTRY + length + number(at + 30, 2)? + number(at + 32, 2)?;
        let start = header + HEADER + number(header + 26, 2)? + number(header + 28, 2)?;
        if file.len() < start + size {
            return Err(cut());
        }
        // The first folder is the name of the archive.
        let inner = name.split_once('/').map_or("", |(_, inner)| inner);
        let is_pickle = inner == "data.pkl";
        let Some(key) = inner.strip_prefix("data/").or(is_pickle.then_some("")) else { continue };
        if method != 0 {
            return Err(format!("its part `{}` is compressed; save it with torch.save", name.escape_debug()));
        }
        if is_pickle {
            pickle = Some(start..start + size);
        } else {
            let offset = |v: usize| u32::try_from(v).map_err(|_| "the file is too long".to_owned());
            storages.insert(key.to_owned(), offset(start)?..offset(start + size)?);
        }
    }
    Ok((pickle.ok_or("it is a ZIP file without a pickle, not an archive of PyTorch")?, storages))
}
