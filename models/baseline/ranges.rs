//! Units and ranges of parameters, from a file next to each card.
//!
//! The file has the tables of the card, and for every parameter an entry: its unit, bounds if it is a
//! number, the accepted values if it is a text, and a description. It is apart from the card because the
//! digest of the card is part of every run, and wider ranges do not change a run.

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize;
use toml::{Table, Value};

use super::ModelError;

/// Ranges of all parameters of a card, by dotted path.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ranges(BTreeMap<String, ParameterRange>);

/// Unit, range and description of a parameter.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(try_from = "RangeEntry")]
pub struct ParameterRange {
    /// Unit; `1` if the parameter has no dimension.
    pub unit: String,
    /// Values that are accepted.
    pub allowed: Allowed,
    /// One-line description.
    pub about: String,
}

/// Values that a parameter accepts. All bounds are inclusive.
#[derive(Clone, Debug, PartialEq)]
pub enum Allowed {
    /// Finite numbers between two bounds.
    Floats {
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
    },
    /// Whole numbers between two bounds.
    Integers {
        /// Smallest value.
        min: i64,
        /// Largest value.
        max: i64,
    },
    /// `true` and `false`.
    Flags,
    /// One of several texts.
    Texts(Vec<String>),
}

/// An entry as the file states it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RangeEntry {
    unit: String,
    about: String,
    min: Option<Value>,
    max: Option<Value>,
    values: Option<Vec<String>>,
}

impl TryFrom<RangeEntry> for ParameterRange {
    type Error = String;

    fn try_from(entry: RangeEntry) -> Result<Self, String> {
        let RangeEntry { unit, about, min, max, values } = entry;
        let allowed = match (min, max, values) {
            (Some(Value::Float(min)), Some(Value::Float(max)), None) if min < max => {
                Allowed::Floats { min, max }
            }
            (Some(Value::Integer(min)), Some(Value::Integer(max)), None) if min < max => {
                Allowed::Integers { min, max }
            }
            (None, None, Some(values)) if !values.is_empty() => Allowed::Texts(values),
            (None, None, None) => Allowed::Flags,
            _ => {
                return Err("expected `min` below `max`, both whole or both with a decimal point, \
                     or a list of `values`, or none of them for `true` and `false`"
                    .to_owned());
            }
        };
        Ok(Self { unit, allowed, about })
    }
}

impl Allowed {
    /// Returns whether a value is accepted; false if it has another type.
    pub fn contains(&self, value: &Value) -> bool {
        match (self, value) {
            (Self::Floats { min, max }, Value::Float(x)) => min <= x && x <= max,
            (Self::Integers { min, max }, Value::Integer(n)) => min <= n && n <= max,
            (Self::Flags, Value::Boolean(_)) => true,
            (Self::Texts(texts), Value::String(text)) => texts.contains(text),
            _ => false,
        }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Floats { min, max } => write!(f, "{min} to {max}"),
            Self::Integers { min, max } => write!(f, "{min} to {max}"),
            Self::Flags => f.write_str("true or false"),
            Self::Texts(texts) => f.write_str(&texts.join(" or ")),
        }
    }
}

impl fmt::Display for ParameterRange {
    /// Writes the range with its unit, such as `0.1 to 10 s`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.unit.as_str() {
            "1" => write!(f, "{}", self.allowed),
            unit => write!(f, "{} {unit}", self.allowed),
        }
    }
}

impl Ranges {
    /// Parses the text of a file of ranges.
    ///
    /// # Errors
    /// [`ModelError`] with line and column, or with the parameter whose entry is invalid.
    pub fn read(id: &'static str, text: &str) -> Result<Self, ModelError> {
        let unreadable = |error: toml::de::Error| {
            ModelError::Refused(format!("the ranges of `{id}` cannot be read: {error}"))
        };
        let table = toml::from_str(text).map_err(unreadable)?;
        let mut ranges = Self::default();
        ranges.add_all(id, "", table)?;
        Ok(ranges)
    }

    /// Adds the entries of a table at a dotted path. A table with a unit is an entry.
    fn add_all(&mut self, id: &'static str, path: &str, table: Table) -> Result<(), ModelError> {
        for (key, value) in table {
            let key = if path.is_empty() { key } else { format!("{path}.{key}") };
            match value {
                Value::Table(inner) if !inner.contains_key("unit") => self.add_all(id, &key, inner)?,
                entry => match entry.try_into() {
                    Ok(range) => {
                        self.0.insert(key, range);
                    }
                    Err(error) => {
                        let text = format!("the range of `{key}` of `{id}` cannot be read: {error}");
                        return Err(ModelError::Refused(text));
                    }
                },
            }
        }
        Ok(())
    }

    /// Returns the range of a parameter.
    pub fn get(&self, key: &str) -> Option<&ParameterRange> {
        self.0.get(key)
    }

    /// Adds the entries of other ranges below a dotted path.
    pub fn extend_below(&mut self, path: &str, other: Self) {
        self.0.extend(other.0.into_iter().map(|(key, range)| (format!("{path}.{key}"), range)));
    }

    /// Returns the entries below a dotted path.
    pub fn below(&self, path: &str) -> Self {
        let own = |(key, range): (&String, &ParameterRange)| {
            Some((key.strip_prefix(path)?.strip_prefix('.')?.to_owned(), range.clone()))
        };
        Self(self.0.iter().filter_map(own).collect())
    }

    /// Returns the dotted paths of all parameters that have a range.
    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }

    /// Checks the value of a parameter; `written` is the value as it was given.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] with the parameter, the value, the range and the unit; [`ModelError`] if it
    /// has none.
    pub fn check(&self, id: &'static str, key: &str, value: &Value, written: &str) -> Result<(), ModelError> {
        let key = key.to_owned();
        match self.get(&key) {
            None => Err(no_range(id, &key)),
            Some(range) if range.allowed.contains(value) => Ok(()),
            Some(range) => {
                Err(ModelError::OutOfRange { id, key, value: written.to_owned(), range: range.to_string() })
            }
        }
    }
}

/// Refuses a parameter without a range.
pub(super) fn no_range(id: &str, key: &str) -> ModelError {
    let remedy = "add one to its file of ranges";
    ModelError::Refused(format!("the parameter `{key}` of `{id}` has no range: {remedy}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "\
        count = { unit = \"1\", min = 0, max = 5, about = \"Number of cars.\" }\n\
        on = { unit = \"1\", about = \"Whether it is on.\" }\n\
        name = { unit = \"1\", values = [\"a\", \"b\"], about = \"Name.\" }\n\
        [car]\n\
        headway = { unit = \"s\", min = 0.1, max = 10.0, about = \"Time headway.\" }\n";

    #[test]
    fn bounds_are_inclusive_and_types_count() {
        let ranges = Ranges::read("some", TEXT).unwrap();
        for (key, value, within) in [
            ("car.headway", Value::Float(0.1), true),
            ("car.headway", Value::Float(10.0), true),
            ("car.headway", Value::Float(0.1_f64.next_down()), false),
            ("car.headway", Value::Float(f64::NAN), false),
            ("car.headway", Value::Integer(1), false),
            ("count", Value::Integer(0), true),
            ("count", Value::Integer(-1), false),
            ("count", Value::Integer(i64::MAX), false),
            ("on", Value::Boolean(false), true),
            ("on", Value::Integer(0), false),
            ("name", Value::String("b".into()), true),
            ("name", Value::String("c".into()), false),
        ] {
            assert_eq!(ranges.check("some", key, &value, "").is_ok(), within, "{key} {value}");
        }
    }

    #[test]
    fn errors_state_parameter_value_range_and_unit() {
        let ranges = Ranges::read("some", TEXT).unwrap();
        for (key, value, text) in [
            ("car.headway", Value::Float(-2.0), "some: `car.headway` is -2, expected 0.1 to 10 s"),
            ("count", Value::Integer(6), "some: `count` is -2, expected 0 to 5"),
            ("name", Value::String("c".into()), "some: `name` is -2, expected a or b"),
            (
                "speed",
                Value::Float(1.0),
                "the parameter `speed` of `some` has no range: add one to its file of ranges",
            ),
        ] {
            assert_eq!(ranges.check("some", key, &value, "-2").unwrap_err().to_string(), text);
        }
    }

    #[test]
    fn entries_that_are_no_ranges_are_refused() {
        for entry in
            ["min = 1.0", "min = 1.0, max = 2", "min = 2.0, max = 1.0", "min = nan, max = 1.0", "values = []"]
        {
            let text = format!("a = {{ unit = \"m\", about = \"A.\", {entry} }}");
            let error = Ranges::read("some", &text).unwrap_err().to_string();
            assert!(error.contains("the range of `a` of `some`"), "{entry}: {error}");
            assert!(error.contains("expected `min` below `max`"), "{entry}: {error}");
        }
    }
}
