//! Incremental decoding of a `SimAgentsChallengeSubmission` message: one scenario in memory at a time.

use std::io::{self, Read};

use reactsim_scene::wosac::ScenarioRollouts;

use super::metadata::SubmissionMetadata;
use super::rollouts::{MAX_LENGTH, decode_rollouts};
use crate::error::Cause;
use crate::wire::put_varint;

/// Tag of the rollouts.
const ROLLOUTS_TAG: u64 = 1;
/// Maximum length of all metadata in bytes.
const MAX_METADATA_LENGTH: usize = 1 << 20;

/// Decoder of the fields of one submission file.
#[derive(Default)]
pub(super) struct SubmissionStream {
    /// The fields of the metadata, as they came.
    metadata: Vec<u8>,
}

/// A field with rollouts, or the end of the file.
pub(super) enum Event {
    /// The rollouts of a scenario, or the reason why they cannot be decoded; the next ones may be valid.
    Rollouts(Result<ScenarioRollouts, Cause>),
    /// The end of the message, with its metadata.
    End(SubmissionMetadata),
}

impl SubmissionStream {
    /// Reads to the next rollouts or to the end. Metadata on the way are kept, other fields are skipped.
    ///
    /// # Errors
    /// The framing is damaged; nothing more of the file can be decoded.
    pub(super) fn next(&mut self, source: &mut dyn Read) -> Result<Event, Cause> {
        while let Some(key) = varint_or_end(source)? {
            let (tag, wire_type) = (key >> 3, key & 7);
            if tag == ROLLOUTS_TAG {
                if wire_type != 2 {
                    return Err(Cause::Undecodable(format!("scenario_rollouts with wire type {wire_type}")));
                }
                let length = varint(source)?;
                let message = fill(source, length, MAX_LENGTH, "the rollouts of a scenario")?;
                return Ok(Event::Rollouts(decode_rollouts(&message)));
            }
            put_varint(&mut self.metadata, key);
            match wire_type {
                0 => put_varint(&mut self.metadata, varint(source)?),
                1 => self.metadata.extend(fill(source, 8, 8, "a number")?),
                2 => {
                    let length = varint(source)?;
                    let content =
                        fill(source, length, MAX_METADATA_LENGTH as u64, "a field of the metadata")?;
                    put_varint(&mut self.metadata, length);
                    self.metadata.extend(content);
                }
                5 => self.metadata.extend(fill(source, 4, 4, "a number")?),
                _ => return Err(Cause::Undecodable(format!("field {tag} has the wire type {wire_type}"))),
            }
            if self.metadata.len() > MAX_METADATA_LENGTH {
                return Err(Cause::value("the length of the metadata", "more than 1 MiB", "at most 1 MiB"));
            }
        }
        Ok(Event::End(SubmissionMetadata::decode(&self.metadata)?))
    }
}

/// Reads bytes of a length that the message states. The buffer grows as they arrive, so that a wrong length
/// allocates nothing.
fn fill(source: &mut dyn Read, length: u64, max_length: u64, what: &'static str) -> Result<Vec<u8>, Cause> {
    if length > max_length {
        return Err(Cause::value(
            format!("the length of {what}"),
            length,
            format!("at most {max_length} bytes"),
        ));
    }
    let mut content = Vec::new();
    let found = source.take(length).read_to_end(&mut content).map_err(Cause::read)? as u64;
    if found < length { Err(Cause::Truncated { what, found, expected: length }) } else { Ok(content) }
}

fn byte(source: &mut dyn Read) -> Result<Option<u8>, Cause> {
    let mut byte = [0];
    loop {
        match source.read(&mut byte) {
            Ok(0) => return Ok(None),
            Ok(_) => return Ok(Some(byte[0])),
            Err(e) if e.kind() == io::ErrorKind::Interrupted => (),
            Err(e) => return Err(Cause::read(e)),
        }
    }
}

/// Reads a number of variable length; `None` at the end of the file.
fn varint_or_end(source: &mut dyn Read) -> Result<Option<u64>, Cause> {
    let mut value = 0;
    for n in 0..10 {
        match byte(source)? {
            None if n == 0 => return Ok(None),
            None => return Err(Cause::Truncated { what: "a number", found: n, expected: n + 1 }),
            Some(byte) => {
                value |= u64::from(byte & 0x7f) << (7 * n);
                if byte & 0x80 == 0 {
                    return Ok(Some(value));
                }
            }
        }
    }
    Err(Cause::Undecodable("a number of more than ten bytes".into()))
}

fn varint(source: &mut dyn Read) -> Result<u64, Cause> {
    let end = Cause::Truncated { what: "a number", found: 0, expected: 1 };
    varint_or_end(source)?.ok_or(end)
}
