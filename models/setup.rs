//! What a baseline is made from: the parameters of its card, some of them changed, and its weights.

use std::error::Error;

use serde::de::DeserializeOwned;
use toml::{Table, Value};

use super::{Card, CardError, WeightsFile};

/// What a baseline is made from.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Id of the baseline.
    pub id: &'static str,
    /// The parameters of its card, with changes.
    pub parameters: Table,
    /// Its weights; always there for a baseline that needs some, never for one that does not.
    pub weights: Option<WeightsFile>,
}

/// Why a baseline can not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// Its card can not be read, or parameters are wrong.
    #[error(transparent)]
    Card(#[from] CardError),
    /// It needs weights and has none.
    #[error(
        "the simulator `{id}` needs weights, which do not ship with the program: give --model-weights {id}=FILE"
    )]
    NoWeights {
        /// Id of the baseline.
        id: &'static str,
    },
    /// It is shown the log's future, or plans by the stage itself: what it plans is not changed.
    #[error(
        "no stage can be put behind the simulator `{id}`: it replays the log, or has the stage in it already"
    )]
    TakesNoStage {
        /// Id of the baseline.
        id: &'static str,
    },
    /// It was given weights and needs none.
    #[error("the simulator `{id}` has no weights: leave --model-weights {id}={file} out")]
    UnwantedWeights {
        /// Id of the baseline.
        id: &'static str,
        /// The file.
        file: String,
    },
    /// The file is not the one of that name which the manifest knows.
    #[error(
        "the weights {file} of `{id}` have the SHA-256 {found}, and {wanted} in the manifest: the file is damaged or another version; \
         get the right one, or give other weights another name"
    )]
    OtherDigest {
        /// Id of the baseline.
        id: &'static str,
        /// The file.
        file: String,
        /// Digest in the manifest.
        wanted: String,
        /// Digest of the file.
        found: String,
    },
    /// The weights can not be used.
    #[error("the weights {file} of `{id}` can not be used: {source}")]
    Weights {
        /// Id of the baseline.
        id: &'static str,
        /// The file.
        file: String,
        /// Why: tensor and mend.
        source: Box<dyn Error + Send + Sync>,
    },
    /// A parameter that the card does not have.
    #[error("the simulator `{id}` has no parameter `{key}`; {known}")]
    UnknownParameter {
        /// Id of the baseline.
        id: &'static str,
        /// Its dotted path.
        key: String,
        /// Which ones there are.
        known: String,
    },
    /// A value of another type than in the card.
    #[error(
        "`{value}` is no value for the parameter `{key}` of `{id}`: its card has {like}, a value of type {wanted}"
    )]
    WrongParameter {
        /// Id of the baseline.
        id: &'static str,
        /// Its dotted path.
        key: String,
        /// What was given.
        value: String,
        /// What the card has.
        like: String,
        /// The type of that.
        wanted: &'static str,
    },
    /// The manifest of weights can not be read.
    #[error("the manifest of weights can not be read: {0}")]
    Manifest(toml::de::Error),
    /// The manifest names a file that is not part of the program.
    #[error("the weights {file} of `{id}` are said to ship with the program and do not")]
    NotEmbedded {
        /// Id of the baseline.
        id: &'static str,
        /// The file.
        file: String,
    },
}

impl Setup {
    /// The parameters of a card, and weights.
    ///
    /// # Errors
    /// [`CardError`].
    pub fn new(id: &'static str, card: &str, weights: Option<WeightsFile>) -> Result<Self, CardError> {
        Ok(Self { id, parameters: Card::read(id, card)?.parameters, weights })
    }

    /// The parameters as the type that the baseline needs.
    ///
    /// # Errors
    /// [`CardError`] that names the missing, unknown or wrong parameter.
    pub fn parameters<T: DeserializeOwned>(&self) -> Result<T, CardError> {
        let parameters = self.parameters.clone();
        parameters.try_into().map_err(|source| CardError { id: self.id, source })
    }

    /// The weights of a baseline that needs some.
    ///
    /// # Errors
    /// [`ModelError::NoWeights`].
    pub fn weights(&self) -> Result<&WeightsFile, ModelError> {
        self.weights.as_ref().ok_or(ModelError::NoWeights { id: self.id })
    }

    /// The error for weights that can not be used, and why.
    pub fn refuse_weights(&self, source: impl Into<Box<dyn Error + Send + Sync>>) -> ModelError {
        let file = self.weights.as_ref().map(|w| w.name.clone()).unwrap_or_default();
        ModelError::Weights { id: self.id, file, source: source.into() }
    }

    /// Changes a parameter: `key` is its dotted path, `value` is written as in TOML, and of the type that the card has there. Quotes
    /// may be left out around text, and the point of whole numbers. Returns the value as TOML writes it.
    ///
    /// # Errors
    /// [`ModelError`] names parameter and value.
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
            wanted: old.type_str(),
        };
        let written = toml::from_str::<Table>(&format!("value = {value}")).ok();
        // No more than the one value may have been written.
        let written = written.filter(|t| t.len() == 1).and_then(|mut t| t.remove("value"));
        let new = match (&old, written) {
            (Value::Float(_), Some(Value::Integer(whole))) => Value::Float(whole as f64),
            (Value::Float(_), Some(Value::Float(x))) if !x.is_finite() => return Err(wrong()),
            (_, Some(new)) if new.same_type(&old) => new,
            (Value::String(_), _) => Value::String(value.to_owned()),
            _ => return Err(wrong()),
        };
        let text = new.to_string();
        if let Some(place) = leaf_mut(&mut self.parameters, key) {
            *place = new;
        }
        Ok(text)
    }
}

/// The value at a dotted path; tables are none.
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

/// The dotted paths of all values.
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
        let wanted = "name = \"b\"\ncount = -7\non = false\n[car.limits]\nspeed = 2.0";
        assert_eq!(setup.parameters, toml::from_str(wanted).unwrap());
    }

    #[test]
    fn what_is_no_parameter_or_no_value_is_refused_by_name() {
        for (key, value, part) in [
            ("speed", "1", "no parameter `speed`; it has: car.limits.speed, count, name, on"),
            ("car", "1", "no parameter `car`"),
            ("car.limits.speed.x", "1", "no parameter `car.limits.speed.x`"),
            ("", "1", "no parameter ``"),
            ("count", "1.5", "`1.5` is no value for the parameter `count` of `some`: its card has 3"),
            ("count", "1\nx = 2", "no value"),
            ("car.limits.speed", "nan", "`nan` is no value"),
            ("car.limits.speed", "fast", "a value of type float"),
            ("on", "1", "a value of type boolean"),
        ] {
            let text = setup().set(key, value).unwrap_err().to_string();
            assert!(text.contains(part), "{text}");
        }
    }
}
