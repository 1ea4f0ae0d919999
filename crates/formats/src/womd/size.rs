//! Size of a message, determined before decoding: few bytes can expand to much memory.

use crate::error::Cause;

/// Maximum number of fields; the largest scenarios have some hundred thousand.
const MAX_FIELDS: usize = 1_000_000;
/// Tags of the scenario fields whose content is counted: tracks, lights by frame, map features.
const NESTED_TAGS: [u64; 3] = [2, 7, 8];
/// Tag of the scenario field with packed ids of agents.
const AGENT_IDS_TAG: u64 = 4;
/// Tag of the scenario field with map features.
const MAP_FEATURES_TAG: u64 = 8;
/// Tags of the map feature fields with lists of ids of at least one byte each.
const ID_LIST_TAGS: [u64; 3] = [1, 9, 10];

/// Refuses messages with more fields than a scenario has. Malformed messages are left to the decoder.
pub(crate) fn check(payload: &[u8]) -> Result<(), Cause> {
    let mut found = 0;
    for (tag, content) in Fields(payload) {
        found += 1;
        if tag == AGENT_IDS_TAG {
            found += content.len();
        }
        if !NESTED_TAGS.contains(&tag) {
            continue;
        }
        for (_, content) in Fields(content) {
            found += 1;
            if tag == MAP_FEATURES_TAG {
                found += Fields(content)
                    .map(|(t, c)| if ID_LIST_TAGS.contains(&t) { 1 + c.len() } else { 1 })
                    .sum::<usize>();
            }
        }
        if found > MAX_FIELDS {
            break;
        }
    }
    if found <= MAX_FIELDS {
        return Ok(());
    }
    Err(Cause::value("the number of fields", format!("more than {MAX_FIELDS}"), "a message of one scenario"))
}

/// Iterator over the fields of a message: tag and content, which is empty for numbers. It ends where the
/// message is malformed.
pub(crate) struct Fields<'a>(pub(crate) &'a [u8]);

impl<'a> Iterator for Fields<'a> {
    type Item = (u64, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let key = self.varint()?;
        let length = match key & 7 {
            0 => {
                self.varint()?;
                0
            }
            1 => 8,
            2 => usize::try_from(self.varint()?).ok()?,
            // Start and end of a group: skipped, but the fields inside are counted.
            3 | 4 => 0,
            5 => 4,
            _ => return None,
        };
        let (content, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some((key >> 3, if key & 7 == 2 { content } else { &[] }))
    }
}

impl Fields<'_> {
    fn varint(&mut self) -> Option<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let (byte, rest) = self.0.split_first()?;
            self.0 = rest;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }
}
