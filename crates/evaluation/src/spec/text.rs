//! Values that files state by the texts of the command line.

use std::fmt::Display;
use std::str::FromStr;

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

pub(super) fn serialize<T: Display, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(value)
}

pub(super) fn deserialize<'de, T, D>(deserializer: D) -> Result<T, D::Error>
where
    T: FromStr<Err: Display>,
    D: Deserializer<'de>,
{
    Text::deserialize(deserializer)?.parse()
}

/// A text in a file. Where a number is a text of the command line, such as `replan = 5`, it is one here.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a text")]
enum Text {
    Number(i64),
    Text(String),
}

impl Text {
    fn parse<T: FromStr<Err: Display>, E: Error>(&self) -> Result<T, E> {
        match self {
            Self::Number(number) => number.to_string().parse().map_err(E::custom),
            Self::Text(text) => text.parse().map_err(E::custom),
        }
    }
}

/// Values that may be absent.
pub(super) mod option {
    use super::{Deserialize, Deserializer, Display, FromStr, Serialize, Serializer, Text};

    #[expect(clippy::ref_option, reason = "the signature that serde needs")]
    pub(in super::super) fn serialize<T: Display, S: Serializer>(
        value: &Option<T>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        value.as_ref().map(ToString::to_string).serialize(serializer)
    }

    pub(in super::super) fn deserialize<'de, T, D>(deserializer: D) -> Result<Option<T>, D::Error>
    where
        T: FromStr<Err: Display>,
        D: Deserializer<'de>,
    {
        Option::<Text>::deserialize(deserializer)?.map(|text| text.parse()).transpose()
    }
}

/// Seeds. Integers of TOML end at 2⁶³ − 1; larger ones are texts.
pub(super) mod seed {
    use super::{Deserialize, Deserializer, Display, Error, Serializer};

    /// A seed in a file.
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "expected an integer from 0 to 18446744073709551615")]
    enum Seed {
        Number(u64),
        Text(String),
    }

    pub(in super::super) fn serialize<T, S>(seed: &T, serializer: S) -> Result<S::Ok, S::Error>
    where
        T: Copy + Display + TryInto<i64>,
        S: Serializer,
    {
        match (*seed).try_into() {
            Ok(number) => serializer.serialize_i64(number),
            Err(_) => serializer.collect_str(seed),
        }
    }

    pub(in super::super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
        match Seed::deserialize(deserializer)? {
            Seed::Number(number) => Ok(number),
            Seed::Text(text) => {
                text.parse::<u64>().map_err(|error| D::Error::custom(format!("`{text}`: {error}")))
            }
        }
    }
}

/// Lists of values.
pub(super) mod list {
    use super::{Deserialize, Deserializer, Display, FromStr, Serializer, Text};

    pub(in super::super) fn serialize<T: Display, S: Serializer>(
        values: &[T],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(values.iter().map(ToString::to_string))
    }

    pub(in super::super) fn deserialize<'de, T, D>(deserializer: D) -> Result<Vec<T>, D::Error>
    where
        T: FromStr<Err: Display>,
        D: Deserializer<'de>,
    {
        Vec::<Text>::deserialize(deserializer)?.iter().map(Text::parse).collect()
    }
}
