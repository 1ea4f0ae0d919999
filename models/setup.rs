//! Setup of a baseline: the parameters of its card, possibly changed, and its weights.

use std::error::Error;

use serde::de::DeserializeOwned;
use toml::{Table, Value};

use super::nn::Backend;
use super::{Card, CardError, ModelError, ParameterRange, Ranges, WeightsFile};

/// Parameters and weights from which a baseline is built.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Id of the baseline.
    pub id: &'static str,
    /// Parameters of its card, with changes applied.
    pub parameters: Table,
    /// Weights: always present for a baseline that needs them, never for one that does not.
    pub weights: Option<WeightsFile>,
    /// Backend of its network, if it has one.
    pub backend: Backend,
    /// Units and ranges of its parameters.
    ranges: Ranges,
}

impl Setup {
    /// Builds a setup from the texts of a card and of the ranges of its parameters, and optional
    /// weights, on the default backend.
    ///
    /// # Errors
    /// [`ModelError`] if the card or the ranges cannot be read.
    pub fn new(
        id: &'static str,
        card: &str,
        ranges: &str,
        weights: Option<WeightsFile>,
    ) -> Result<Self, ModelError> {
        let parameters = Card::read(id, card)?.parameters;
        let ranges = Ranges::read(id, ranges)?;
        Ok(Self { id, parameters, weights, backend: Backend::default(), ranges })
    }

    /// Deserializes the parameters into the type that the baseline needs, after a check that all are
    /// within their ranges.
    ///
    /// # Errors
    /// [`ModelError`] naming the missing, unknown or invalid parameter.
    pub fn parameters<T: DeserializeOwned>(&self) -> Result<T, ModelError> {
        for (key, value) in leaves(&self.parameters) {
            self.ranges.check(self.id, &key, value, &value.to_string())?;
        }
        let parameters = self.parameters.clone();
        Ok(parameters.try_into().map_err(|source| CardError { id: self.id, source })?)
    }

    /// Returns the dotted path, value and range of every parameter.
    ///
    /// # Errors
    /// [`ModelError::NoRange`] for a parameter without a range.
    pub fn ranges(&self) -> Result<Vec<(String, &Value, &ParameterRange)>, ModelError> {
        let leaves = leaves(&self.parameters).into_iter();
        leaves
            .map(|(key, value)| match self.ranges.get(&key) {
                Some(range) => Ok((key, value, range)),
                None => Err(ModelError::NoRange { id: self.id, key }),
            })
            .collect()
    }

    /// Checks that a parameter is at most as large as another one.
    ///
    /// # Errors
    /// [`ModelError::Order`] naming both parameters and their values.
    pub fn require_order(&self, lower: &'static str, upper: &'static str) -> Result<(), ModelError> {
        let value = |key: &str| leaf(&self.parameters, key).and_then(Value::as_float);
        match (value(lower), value(upper)) {
            (Some(lower_value), Some(upper_value)) if lower_value > upper_value => {
                Err(ModelError::Order { id: self.id, lower, lower_value, upper, upper_value })
            }
            _ => Ok(()),
        }
    }

    /// Returns the weights.
    ///
    /// # Errors
    /// [`ModelError::NoWeights`].
    pub fn weights(&self) -> Result<&WeightsFile, ModelError> {
        self.weights.as_ref().ok_or(ModelError::NoWeights { id: self.id })
    }

    /// Returns the error for weights that cannot be used, with its cause.
    pub fn refuse_weights(&self, source: impl Into<Box<dyn Error + Send + Sync>>) -> ModelError {
        let file = self.weights.as_ref().map(|w| w.name.clone()).unwrap_or_default();
        ModelError::Weights { id: self.id, file, source: source.into() }
    }

    /// Changes a parameter. `key` is its dotted path; `value` is written as in TOML and has the
    /// type of the value in the card. Quotes around text may be omitted, and a whole number is
    /// accepted for a float. Returns the value as TOML writes it.
    ///
    /// # Errors
    /// [`ModelError`] naming the parameter, the value and, if it is not within it, the range.
    pub fn set(&mut self, key: &str, value: &str) -> Result<String, ModelError> {
        let unknown = |known: &Table| {
            let paths: Vec<String> = leaves(known).into_iter().map(|(path, _)| path).collect();
            let known = match paths.len() {
                0 => "it has none".to_owned(),
                _ => format!("it has: {}", paths.join(", ")),
            };
            ModelError::UnknownParameter { id: self.id, key: key.to_owned(), known }
        };
        let Some(old) = leaf(&self.parameters, key).cloned() else { return Err(unknown(&self.parameters)) };
        let wrong = || ModelError::WrongParameter {
            id: self.id,
            key: key.to_owned(),
            value: value.to_owned(),
            like: old.to_string(),
            expected: old.type_str(),
        };
        let written = toml::from_str::<Table>(&format!("value = {value}")).ok();
        // Reject text that defines more than this one value.
        let written = written.filter(|t| t.len() == 1).and_then(|mut t| t.remove("value"));
        let new = match (&old, written) {
            (Value::Float(_), Some(Value::Integer(whole))) => Value::Float(whole as f64),
            (_, Some(new)) if new.same_type(&old) => new,
            (Value::String(_), _) => Value::String(value.to_owned()),
            _ => return Err(wrong()),
        };
        self.ranges.check(self.id, key, &new, value)?;
        let text = new.to_string();
        if let Some(slot) = leaf_mut(&mut self.parameters, key) {
            *slot = new;
        }
        Ok(text)
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

    const CARD: &str = "title = \"T\"\nsummary = \"S\"\ncontrols = \"C\"\nsources = []\n\
        [parameters]\nname = \"a\"\ncount = 3\non = true\n[parameters.car.limits]\nspeed = 1.5\n";

    const RANGES: &str = "\
        name = { unit = \"1\", values = [\"a\", \"b\", \"b c\"], about = \"Name.\" }\n\
        count = { unit = \"1\", min = -7, max = 9, about = \"Number of cars.\" }\n\
        on = { unit = \"1\", about = \"Whether it is on.\" }\n\
        [car.limits]\n\
        speed = { unit = \"m/s\", min = 0.5, max = 60.0, about = \"Largest speed.\" }\n";

    fn setup() -> Setup {
        Setup::new("some", CARD, RANGES, None).unwrap()
    }

    #[test]
    fn parameters_are_changed_by_path() {
        let mut setup = setup();
        for (key, value, text) in [
            ("car.limits.speed", "2.25", "2.25"),
            ("car.limits.speed", "2", "2.0"),
            ("count", "-7", "-7"),
            ("on", "false", "false"),
            ("name", "\"b c\"", "\"b c\""),
            ("name", "b", "\"b\""),
        ] {
            assert_eq!(setup.set(key, value).unwrap(), text);
        }
        let expected = "name = \"b\"\ncount = -7\non = false\n[car.limits]\nspeed = 2.0";
        assert_eq!(setup.parameters, toml::from_str(expected).unwrap());
    }

    #[test]
    fn unknown_parameters_and_invalid_values_are_named() {
        for (key, value, part) in [
            ("speed", "1", "no parameter `speed`; it has: car.limits.speed, count, name, on"),
            ("car", "1", "no parameter `car`"),
            ("car.limits.speed.x", "1", "no parameter `car.limits.speed.x`"),
            ("", "1", "no parameter ``"),
            ("count", "1.5", "`1.5` is not a valid `count` for `some`: its card has 3"),
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
            let text = setup().set(key, value).unwrap_err().to_string();
            assert!(text.contains(part), "{text}");
        }
    }

    #[test]
    fn values_that_were_not_set_by_path_are_checked_too() {
        let mut setup = setup();
        assert!(setup.parameters::<Table>().is_ok());
        setup.parameters["count"] = Value::Integer(10);
        let text = setup.parameters::<Table>().unwrap_err().to_string();
        assert_eq!(text, "some: `count` is 10, expected -7 to 9");
    }

    #[test]
    fn the_order_of_two_parameters_is_checked() {
        let card = format!("{CARD}[parameters.car.wishes]\nspeed = 2.0\n");
        let wishes =
            "[car.wishes]\nspeed = { unit = \"m/s\", min = 0.5, max = 60.0, about = \"Desired speed.\" }";
        let ranges = format!("{RANGES}{wishes}");
        let setup = Setup::new("some", &card, &ranges, None).unwrap();
        setup.require_order("car.limits.speed", "car.wishes.speed").unwrap();
        let text = setup.require_order("car.wishes.speed", "car.limits.speed").unwrap_err().to_string();
        assert_eq!(text, "some: `car.wishes.speed` is 2, expected at most `car.limits.speed`, which is 1.5");
    }
}
