//! Names of the files of a submission: `NAME.binproto` or `NAME.binproto-00000-of-00150`.

use std::collections::BTreeSet;

use crate::error::Cause;

/// Ending of the names before the number.
const ENDING: &str = ".binproto";
/// Expected names, for errors.
const EXPECTED: &str = "a file named `NAME.binproto-00000-of-00150` or `NAME.binproto` at the top level";

/// The names seen in a submission.
#[derive(Default)]
pub(super) struct Shards {
    names: BTreeSet<String>,
    numbers: BTreeSet<u32>,
    count: Option<u32>,
}

/// Returns the name of the file with this number.
pub(super) fn shard_name(name: &str, number: u32, count: u32) -> String {
    format!("{name}{ENDING}-{number:05}-of-{count:05}")
}

/// Returns number and count of a name that ends with them; `Some(None)` for a name without them, `None` if it
/// is no name of a submission's file.
fn number(name: &str) -> Option<Option<(u32, u32)>> {
    let (_, rest) = name.rsplit_once(ENDING)?;
    if rest.is_empty() {
        return Some(None);
    }
    let (number, count) = rest.strip_prefix('-')?.split_once("-of-")?;
    let digits = |text: &str| {
        (text.len() == 5 && text.bytes().all(|b| b.is_ascii_digit())).then(|| text.parse().ok()).flatten()
    };
    Some(Some((digits(number)?, digits(count)?)))
}

impl Shards {
    /// Returns whether a file is named as those of a submission.
    pub(super) fn is_name(name: &str) -> bool {
        number(name).is_some()
    }

    /// Adds a file by its path in the submission.
    ///
    /// # Errors
    /// The name is not that of a submission's file, was seen before, or has another count than the names
    /// before it.
    pub(super) fn add(&mut self, path: &str) -> Result<(), Cause> {
        let name = path.strip_prefix("./").unwrap_or(path);
        let number = number(name).filter(|_| !name.contains('/'));
        let number = number.ok_or_else(|| Cause::value("the name", format!("`{path}`"), EXPECTED))?;
        if !self.names.insert(name.to_owned()) {
            return Err(Cause::value("the name", format!("`{path}`, twice"), "different names"));
        }
        if let Some((number, count)) = number {
            if number >= count || *self.count.get_or_insert(count) != count {
                let expected = format!("a number below {}", self.count.unwrap_or(count));
                return Err(Cause::value("the number of the file", format!("{number} of {count}"), expected));
            }
            self.numbers.insert(number);
        }
        Ok(())
    }

    pub(super) fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Checks that no file is missing.
    pub(super) fn check(&self) -> Result<(), Cause> {
        let Some(count) = self.count else { return Ok(()) };
        match (0..count).find(|number| !self.numbers.contains(number)) {
            None => Ok(()),
            Some(missing) => {
                let found = format!("{} of {count}, without number {missing}", self.numbers.len());
                Err(Cause::value("the number of files", found, "all files of the submission"))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_a_number_or_none() {
        assert_eq!(number(&shard_name("a.b", 3, 150)), Some(Some((3, 150))));
        assert_eq!(number("a.binproto"), Some(None));
        for other in ["a.binproto-0-of-1", "a.binproto-00000", "a.txt", "a.binproto-00000-of-00150x"] {
            assert_eq!(number(other), None, "{other}");
        }
    }

    #[test]
    fn missing_and_repeated_files_are_found() {
        let mut shards = Shards::default();
        shards.add("./a.binproto-00000-of-00002").unwrap();
        let text = |result: Result<(), Cause>| result.unwrap_err().to_string();
        assert!(text(shards.check()).contains("1 of 2, without number 1"));
        assert!(text(shards.add("a.binproto-00000-of-00002")).contains("twice"));
        assert!(text(shards.add("x/a.binproto-00001-of-00002")).contains("top level"));
        assert!(text(shards.add("a.binproto-00001-of-00003")).contains("1 of 3"));
        shards.add("a.binproto-00001-of-00002").unwrap();
        shards.check().unwrap();
    }
}
