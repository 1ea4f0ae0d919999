//! The subset of the Apache Thrift compact protocol that footers and headers of pages of Parquet need.

/// Maximum nesting depth of structures.
const MAX_DEPTH: u32 = 16;

/// Field type of lists.
pub(super) const LIST: u8 = 9;
/// Field type of structures.
pub(super) const STRUCTURE: u8 = 12;

/// Reader of encoded data. All methods return `None` for malformed data.
pub(super) struct CompactReader<'a> {
    data: &'a [u8],
}

impl<'a> CompactReader<'a> {
    pub(super) fn new(data: &'a [u8]) -> Self {
        Self { data }
    }

    /// Returns the data not read yet.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.data
    }

    /// Reads id and type of the next field of a structure, whose previous field had the id `last`;
    /// `Some(None)` at the end of the structure.
    pub(super) fn field(&mut self, last: &mut i64) -> Option<Option<(i64, u8)>> {
        let head = self.byte()?;
        if head == 0 {
            return Some(None);
        }
        let step = i64::from(head >> 4);
        *last = if step == 0 { self.whole()? } else { last.checked_add(step)? };
        // The library keeps sixteen bits of an id, so it could take a greater id for that of another field.
        i16::try_from(*last).ok()?;
        Some(Some((*last, head & 15)))
    }

    /// Reads a whole number.
    pub(super) fn whole(&mut self) -> Option<i64> {
        let number = self.unsigned()?;
        Some((number >> 1) as i64 ^ -((number & 1) as i64))
    }

    /// Reads the type of the elements of a list, and their number.
    pub(super) fn list(&mut self) -> Option<(u8, u64)> {
        let head = self.byte()?;
        let count = if head >> 4 == 15 { self.unsigned()? } else { u64::from(head >> 4) };
        Some((head & 15, count))
    }

    /// Returns the value of a boolean field, which is part of its type.
    pub(super) fn flag(kind: u8) -> Option<bool> {
        match kind {
            1 => Some(true),
            2 => Some(false),
            _ => None,
        }
    }

    /// Skips the value of a field.
    pub(super) fn skip(&mut self, kind: u8) -> Option<()> {
        self.skip_at(kind, MAX_DEPTH)
    }

    fn skip_at(&mut self, kind: u8, depth: u32) -> Option<()> {
        let depth = depth.checked_sub(1)?;
        match kind {
            1 | 2 => {}
            3 => _ = self.byte()?,
            4..=6 => _ = self.unsigned()?,
            7 => self.pass(8)?,
            8 => {
                let length = self.unsigned()?;
                self.pass(length)?;
            }
            LIST | 10 => {
                let (kind, count) = self.list()?;
                for _ in 0..count {
                    self.skip_element(kind, depth)?;
                }
            }
            STRUCTURE => {
                let mut last = 0;
                while let Some((_, kind)) = self.field(&mut last)? {
                    self.skip_at(kind, depth)?;
                }
            }
            _ => return None,
        }
        Some(())
    }

    /// Skips an element of a list; refuses booleans. Booleans in lists have a byte each, but the library
    /// consumes none when it skips them: a few bytes can keep it busy for hours, and it continues at another
    /// position than this reader. Skipped parts of valid Parquet files contain no such lists.
    fn skip_element(&mut self, kind: u8, depth: u32) -> Option<()> {
        if matches!(kind, 1 | 2) { None } else { self.skip_at(kind, depth) }
    }

    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.data.split_first()?;
        self.data = rest;
        Some(*first)
    }

    fn pass(&mut self, bytes: u64) -> Option<()> {
        self.data = self.data.get(usize::try_from(bytes).ok()?..)?;
        Some(())
    }

    fn unsigned(&mut self) -> Option<u64> {
        let mut number = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            number |= u64::from(byte & 127) << shift;
            if byte & 128 == 0 {
                return Some(number);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_read_and_skipped() {
        // {1: -3, 4: true, 5: {1: "ab"}, 6: [1, 2], 40: 300}, then another byte.
        let data = [0x15, 5, 0x31, 0x1c, 0x18, 2, b'a', b'b', 0, 0x19, 0x25, 2, 4, 0x05, 80, 0xd8, 4, 0, 9];
        let mut reader = CompactReader::new(&data);
        let mut last = 0;
        assert_eq!(reader.field(&mut last), Some(Some((1, 5))));
        assert_eq!(reader.whole(), Some(-3));
        assert_eq!(reader.field(&mut last), Some(Some((4, 1))));
        assert_eq!(CompactReader::flag(1), Some(true));
        for expected in [(5, 12), (6, 9)] {
            let found = reader.field(&mut last).flatten().unwrap();
            assert_eq!(found, expected);
            reader.skip(found.1).unwrap();
        }
        assert_eq!(reader.field(&mut last), Some(Some((40, 5))));
        assert_eq!(reader.whole(), Some(300));
        assert_eq!(reader.field(&mut last), Some(None));
        assert_eq!(reader.rest(), [9]);
    }

    #[test]
    fn endless_data_are_refused() {
        assert_eq!(CompactReader::new(&[0x1c; 4096]).skip(12), None, "deep");
        assert_eq!(CompactReader::new(&[0xf5, 0xff, 0xff, 0xff, 0xff, 15]).skip(9), None, "long list");
        assert_eq!(CompactReader::new(&[255; 20]).whole(), None, "long number");
        assert_eq!(CompactReader::new(&[200, 1, 7]).skip(8), None, "long text");
        assert_eq!(CompactReader::new(&[]).field(&mut 0), None);
        assert_eq!(CompactReader::new(&[0x05, 0x84, 0x80, 8, 0]).field(&mut 0), None, "the id 65538");
        assert_eq!(CompactReader::new(&[0x51, 1, 1, 1, 1, 1]).skip(9), None, "booleans");
        // A list of a billion booleans in no bytes.
        assert_eq!(CompactReader::new(&[0xf1, 0x80, 0x94, 0xeb, 0xdc, 3]).skip(9), None);
    }
}
