//! Setup of a baseline: the parameters of its card, possibly changed, and its weights.

use std::error::Error;

use serde::de::DeserializeOwned;
use toml::{Table, Value};

use super::nn::Backend;
use super::{Card, CardError, ModelError, WeightsFile};

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
}

impl Setup {
    /// Builds a setup from the text of a card and optional weights, on the default backend.
    ///
    /// # Errors
    /// [`CardError`].
    pub fn new(id: &'static str, card: &str, weights: Option<WeightsFile>) -> Result<Self, CardError> {
        Ok(Self { id, parameters: Card::read(id, card)?.parameters, weights, backend: Backend::default() })
    }

    /// Deserializes the parameters into the type that the baseline needs.
    ///
    /// # Errors
    /// [`CardError`] naming the missing, unknown or invalid parameter.
    pub fn parameters<T: DeserializeOwned>(&self) -> Result<T, CardError> {
        let parameters = self.parameters.clone();
        parameters.try_into().map_err(|source| CardError { id: self.id, source })
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
    /// [`ModelError`] naming the parameter and the value.
    pub fn set(&mut self, key: &str, value: &str) -> Result<String, ModelError> {
        let unknown = |known: &Table| {
            let mut paths = Vec::new();
            leaves("", known, &mut paths);
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
            (Value::Float(_), Some(Value::Float(x))) if !x.is_finite() => return Err(wrong()),
            (_, Some(new)) if new.same_type(&old) => new,
            (Value::String(_), _) => Value::String(value.to_owned()),
            _ => return Err(wrong()),
        };
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

/// Collects the dotted paths of all values.
fn leaves(path: &str, table: &Table, out: &mut Vec<String>) {
    for (key, value) in table {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        match value.as_table() {
            Some(table) => leaves(&path, table, out),
            None => out.push(path),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CARD: &str = "title = \"T\"\nsummary = \"S\"\ncontrols = \"C\"\nsources = []\n\
        [parameters]\nname = \"a\"\ncount = 3\non = true\n[parameters.car.limits]\nspeed = 1.5\n";

    fn setup() -> Setup {
        Setup::new("some", CARD, None).unwrap()
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
            ("car.limits.speed", "nan", "`nan` is not a valid"),
            ("car.limits.speed", "fast", "a value of type float"),
            ("on", "1", "a value of type boolean"),
        ] {
            let text = setup().set(key, value).unwrap_err().to_string();
            assert!(text.contains(part), "{text}");
        }
    }
}
