//! How much a message will hold, found before it is decoded: few bytes can stand for much memory.

use crate::formats::error::Cause;

/// Most fields: those of the largest scenarios are some hundred thousand.
const MOST: usize = 1_000_000;
/// Fields of a scenario whose content is looked at (tracks, lights by frame, map features), and the ids of agents.
const NESTED: [u64; 3] = [2, 7, 8];
const IDS: u64 = 4;
const FEATURES: u64 = 8;
/// Fields of map features that hold lists of ids, one byte each at least.
const LANES: [u64; 3] = [1, 9, 10];

/// Refuses a message of more fields than a scenario has. What is no message at all is left to the decoder.
pub(super) fn check(payload: &[u8]) -> Result<(), Cause> {
    let mut found = 0;
    for (tag, content) in Fields(payload) {
        found += 1;
        if tag == IDS {
            found += content.len();
        }
        if !NESTED.contains(&tag) {
            continue;
        }
        for (_, content) in Fields(content) {
            found += 1;
            if tag == FEATURES {
                found += Fields(content)
                    .map(|(t, c)| if LANES.contains(&t) { 1 + c.len() } else { 1 })
                    .sum::<usize>();
            }
        }
        if found > MOST {
            break;
        }
    }
    if found <= MOST {
        return Ok(());
    }
    Err(Cause::value("the number of fields", format!("more than {MOST}"), "a message of one scenario"))
}

/// The fields of a message: number and content, which is empty for numbers. They end where the message does not go on as one.
struct Fields<'a>(&'a [u8]);

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
            // Begin and end of a group, which is passed over; its content counts as well.
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
