//! Named values with units and ranges: the parameters of a card, or a recipe.

use serde::de::DeserializeOwned;
use toml::{Table, Value};

use super::card::unreadable;
use super::ranges::no_range;
use super::{ModelError, ParameterRange, Ranges};

/// Values by dotted path, each with a unit and a range.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// Id of the baseline or training task that they belong to, for messages.
    id: &'static str,
    values: Table,
    ranges: Ranges,
}

impl Parameters {
    /// Combines default values with their ranges.
    pub fn new(id: &'static str, values: Table, ranges: Ranges) -> Self {
        Self { id, values, ranges }
    }

    /// Returns the values.
    pub fn values(&self) -> &Table {
        &self.values
    }

    /// Deserializes the values, after a check that all are within their ranges.
    ///
    /// # Errors
    /// [`ModelError`] naming the missing, unknown or invalid parameter.
    pub fn get<T: DeserializeOwned>(&self) -> Result<T, ModelError> {
        self.check()?;
        self.values.clone().try_into().map_err(|error| unreadable(self.id, &error))
    }

    /// Separates the values of a table from the others.
    pub fn split_off(mut self, name: &str) -> (Self, Self) {
        let table = match self.values.remove(name) {
            Some(Value::Table(table)) => table,
            _ => Table::new(),
        };
        let own = Self { id: self.id, values: table, ranges: self.ranges.below(name) };
        (self, own)
    }

    /// Checks that all values are within their ranges.
    ///
    /// # Errors
    /// [`ModelError`] naming the first parameter that is not.
    pub fn check(&self) -> Result<(), ModelError> {
        let check =
            |(key, value): (String, &Value)| self.ranges.check(self.id, &key, value, &value.to_string());
        leaves(&self.values).into_iter().try_for_each(check)
    }

    /// Returns the dotted path, value and range of every parameter.
    ///
    /// # Errors
    /// [`ModelError`] for a parameter without a range.
    pub fn ranges(&self) -> Result<Vec<(String, &Value, &ParameterRange)>, ModelError> {
        let leaves = leaves(&self.values).into_iter();
        leaves
            .map(|(key, value)| match self.ranges.get(&key) {
                Some(range) => Ok((key, value, range)),
                None => Err(no_range(self.id, &key)),
            })
            .collect()
    }

    /// Checks that a parameter is at most as large as another one.
    ///
    /// # Errors
    /// [`ModelError::Order`] naming both parameters and their values.
    pub fn require_order(&self, lower: &'static str, upper: &'static str) -> Result<(), ModelError> {
        let value = |key: &str| leaf(&self.values, key).and_then(Value::as_float);
        match (value(lower), value(upper)) {
            (Some(lower_value), Some(upper_value)) if lower_value > upper_value => {
                Err(ModelError::Order { id: self.id, lower, lower_value, upper, upper_value })
            }
            _ => Ok(()),
        }
    }

    /// Changes a parameter. `key` is its dotted path; `value` is written as in TOML and has the
    /// type of the present value. Quotes around text may be omitted, and a whole number is
    /// accepted for a float. Returns the value as TOML writes it.
    ///
    /// # Errors
    /// [`ModelError`] naming the parameter, the value and, if it is not within it, the range.
    pub fn set(&mut self, key: &str, value: &str) -> Result<String, ModelError> {
        let written = toml::from_str::<Table>(&format!("value = {value}")).ok();
        // Reject text that defines more than this one value.
        let written = written.filter(|t| t.len() == 1).and_then(|mut t| t.remove("value"));
        self.replace(key, written, value)
    }

    /// Changes all parameters that a table states, such as one read from a file. All or none are changed.
    ///
    /// # Errors
    /// As [`Self::set`], for the first value that is refused.
    pub fn merge(&mut self, table: &Table) -> Result<(), ModelError> {
        let mut merged = self.clone();
        for (key, value) in leaves(table) {
            merged.replace(&key, Some(value.clone()), &value.to_string())?;
        }
        *self = merged;
        Ok(())
    }

    /// Replaces a value by another of its type; `written` is how it was given.
    fn replace(&mut self, key: &str, new: Option<Value>, written: &str) -> Result<String, ModelError> {
        let Some(old) = leaf(&self.values, key).cloned() else { return Err(self.unknown(key)) };
        let new = match (&old, new) {
            (Value::Float(_), Some(Value::Integer(whole))) => Value::Float(whole as f64),
            (_, Some(new)) if new.same_type(&old) => new,
            (Value::String(_), _) => Value::String(written.to_owned()),
            _ => {
                let (id, expected) = (self.id, old.type_str());
                return Err(ModelError::Refused(format!(
                    "`{written}` is not a valid `{key}` for `{id}`: expected a value of type {expected}, \
                     such as {old}"
                )));
            }
        };
        self.ranges.check(self.id, key, &new, written)?;
        let text = new.to_string();
        if let Some(slot) = leaf_mut(&mut self.values, key) {
            *slot = new;
        }
        Ok(text)
    }

    fn unknown(&self, key: &str) -> ModelError {
        let paths: Vec<String> = leaves(&self.values).into_iter().map(|(path, _)| path).collect();
        let known = match paths.len() {
            0 => "it has none".to_owned(),
            _ => format!("it has: {}", paths.join(", ")),
        };
        ModelError::UnknownParameter { id: self.id, key: key.to_owned(), known }
    }
}

/// Returns the value at a dotted path, or `None` for a table.
fn leaf<'a>(table: &'a Table, path: &str) -> Option<&'a Value> {
    match path.split_once('.') {
        Some((first, rest)) => leaf(table.get(first)?.as_table()?, rest),
        None => table.get(path).filter(|v| !v.is_table()),
    }
}

fn leaf_mut<'a>(table: &'a mut Table, path: &str) -> Option<&'a mut Value> {
    match path.split_once('.') {
        Some((first, rest)) => leaf_mut(table.get_mut(first)?.as_table_mut()?, rest),
        None => table.get_mut(path),
    }
}

/// Returns all values with their dotted paths.
fn leaves(table: &Table) -> Vec<(String, &Value)> {
    let mut found = Vec::new();
    for (key, value) in table {
        match value.as_table() {
            Some(inner) => found.extend(leaves(inner).into_iter().map(|(k, v)| (format!("{key}.{k}"), v))),
            None => found.push((key.clone(), value)),
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const VALUES: &str = "name = \"a\"\ncount = 3\non = true\n[car.limits]\nspeed = 1.5\n";

    const RANGES: &str = "\
        name = { unit = \"1\", values = [\"a\", \"b\", \"b c\"], about = \"Name.\" }\n\
        count = { unit = \"1\", min = -7, max = 9, about = \"Number of cars.\" }\n\
        on = { unit = \"1\", about = \"Whether it is on.\" }\n\
        [car.limits]\n\
        speed = { unit = \"m/s\", min = 0.5, max = 60.0, about = \"Largest speed.\" }\n";

    fn parameters() -> Parameters {
        Parameters::new("some", toml::from_str(VALUES).unwrap(), Ranges::read("some", RANGES).unwrap())
    }

    #[test]
    fn parameters_are_changed_by_path() {
        let mut parameters = parameters();
        for (key, value, text) in [
            ("car.limits.speed", "2.25", "2.25"),
            ("car.limits.speed", "2", "2.0"),
            ("count", "-7", "-7"),
            ("on", "false", "false"),
            ("name", "\"b c\"", "\"b c\""),
            ("name", "b", "\"b\""),
        ] {
            assert_eq!(parameters.set(key, value).unwrap(), text);
        }
        let expected = "name = \"b\"\ncount = -7\non = false\n[car.limits]\nspeed = 2.0";
        assert_eq!(*parameters.values(), toml::from_str(expected).unwrap());
    }

    #[test]
    fn unknown_parameters_and_invalid_values_are_named() {
        for (key, value, part) in [
            ("speed", "1", "no parameter `speed`; it has: car.limits.speed, count, name, on"),
            ("car", "1", "no parameter `car`"),
            ("car.limits.speed.x", "1", "no parameter `car.limits.speed.x`"),
            ("", "1", "no parameter ``"),
            (
                "count",
                "1.5",
                "`1.5` is not a valid `count` for `some`: expected a value of type integer, such as 3",
            ),
            ("count", "1\nx = 2", "not a valid"),
            ("car.limits.speed", "nan", "`car.limits.speed` is nan, expected"),
            ("car.limits.speed", "inf", "`car.limits.speed` is inf, expected"),
            ("car.limits.speed", "fast", "a value of type float"),
            ("on", "1", "a value of type boolean"),
            ("car.limits.speed", "-2", "some: `car.limits.speed` is -2, expected 0.5 to 60 m/s"),
            ("car.limits.speed", "1e308", "is 1e308, expected"),
            ("count", "9223372036854775807", "`count` is 9223372036854775807, expected -7 to 9"),
            ("name", "d", "`name` is d, expected a or b or b c"),
        ] {
            let text = parameters().set(key, value).unwrap_err().to_string();
            assert!(text.contains(part), "{text}");
        }
    }

    #[test]
    fn values_that_were_not_set_by_path_are_checked_too() {
        let mut parameters = parameters();
        assert!(parameters.get::<Table>().is_ok());
        parameters.values["count"] = Value::Integer(10);
        let text = parameters.get::<Table>().unwrap_err().to_string();
        assert_eq!(text, "some: `count` is 10, expected -7 to 9");
    }

    #[test]
    fn a_table_changes_all_that_it_states_or_nothing() {
        let mut parameters = parameters();
        parameters.merge(&toml::from_str("count = 5\n[car]\nlimits = { speed = 3 }").unwrap()).unwrap();
        let expected = "name = \"a\"\ncount = 5\non = true\n[car.limits]\nspeed = 3.0";
        assert_eq!(*parameters.values(), toml::from_str(expected).unwrap());
        let before = parameters.clone();
        for (text, part) in [
            ("count = 2\nspeed = 1.0", "no parameter `speed`"),
            ("count = 2\n[car]\nlimits = 3", "no parameter `car.limits`"),
            ("count = 2\non = 3", "`3` is not a valid `on`"),
            ("count = 20", "`count` is 20, expected -7 to 9"),
        ] {
            let error = parameters.merge(&toml::from_str(text).unwrap()).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
            assert_eq!(parameters, before);
        }
    }

    #[test]
    fn a_table_is_separated_with_its_ranges() {
        let (others, car) = parameters().split_off("car");
        assert_eq!(*others.values(), toml::from_str("name = \"a\"\ncount = 3\non = true").unwrap());
        assert_eq!(car.ranges().unwrap()[0].0, "limits.speed");
        car.check().unwrap();
    }

    #[test]
    fn the_order_of_two_parameters_is_checked() {
        let values = format!("{VALUES}[car.wishes]\nspeed = 2.0\n");
        let wishes =
            "[car.wishes]\nspeed = { unit = \"m/s\", min = 0.5, max = 60.0, about = \"Desired speed.\" }";
        let ranges = Ranges::read("some", &format!("{RANGES}{wishes}")).unwrap();
        let parameters = Parameters::new("some", toml::from_str(&values).unwrap(), ranges);
        parameters.require_order("car.limits.speed", "car.wishes.speed").unwrap();
        let text = parameters.require_order("car.wishes.speed", "car.limits.speed").unwrap_err().to_string();
        assert_eq!(text, "some: `car.wishes.speed` is 2, expected at most `car.limits.speed`, which is 1.5");
    }
}
