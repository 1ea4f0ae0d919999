//! JSON values of documents.

use std::borrow::Cow;
use std::fmt;

use reactsim_geometry::{Polygon, Vec2};
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{self, Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};

/// A number, or `None` for null. NaN and infinities arrive as strings, see [`quote_not_finite`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Number(pub(super) Option<f64>);

impl Number {
    /// Returns the number, NaN for null.
    pub(crate) fn or_nan(self) -> f64 {
        self.0.unwrap_or(f64::NAN)
    }
}

/// Implements the visitor's methods for all representations of a number.
macro_rules! numbers {
    ($value:ty, $wrap:expr) => {
        fn visit_f64<E: de::Error>(self, v: f64) -> Result<$value, E> {
            Ok($wrap(v))
        }

        fn visit_i64<E: de::Error>(self, v: i64) -> Result<$value, E> {
            Ok($wrap(v as f64))
        }

        fn visit_u64<E: de::Error>(self, v: u64) -> Result<$value, E> {
            Ok($wrap(v as f64))
        }

        fn visit_str<E: de::Error>(self, v: &str) -> Result<$value, E> {
            match v {
                "NaN" => Ok($wrap(f64::NAN)),
                "Infinity" => Ok($wrap(f64::INFINITY)),
                "-Infinity" => Ok($wrap(f64::NEG_INFINITY)),
                _ => Err(E::invalid_type(de::Unexpected::Str(v), &self)),
            }
        }
    };
}

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NumberVisitor;
        impl Visitor<'_> for NumberVisitor {
            type Value = Number;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number or null")
            }

            numbers!(Number, |v| Number(Some(v)));

            fn visit_unit<E>(self) -> Result<Number, E> {
                Ok(Number(None))
            }
        }
        deserializer.deserialize_any(NumberVisitor)
    }
}

/// A size: one number, or one per frame.
#[derive(Clone, Debug)]
pub(super) enum Size {
    One(f64),
    PerFrame(Vec<Number>),
}

impl<'de> Deserialize<'de> for Size {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct SizeVisitor;
        impl<'de> Visitor<'de> for SizeVisitor {
            type Value = Size;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a size in metres, or one per frame")
            }

            numbers!(Size, Size::One);

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Size, A::Error> {
                Deserialize::deserialize(SeqAccessDeserializer::new(seq)).map(Size::PerFrame)
            }
        }
        deserializer.deserialize_any(SizeVisitor)
    }
}

/// An id: a string, or a whole number that is converted to one.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Name(pub(super) String);

impl<'de> Deserialize<'de> for Name {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NameVisitor;
        impl Visitor<'_> for NameVisitor {
            type Value = Name;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an id (a string or a whole number)")
            }

            fn visit_str<E>(self, v: &str) -> Result<Name, E> {
                Ok(Name(v.to_owned()))
            }

            fn visit_i64<E>(self, v: i64) -> Result<Name, E> {
                Ok(Name(v.to_string()))
            }

            fn visit_u64<E>(self, v: u64) -> Result<Name, E> {
                Ok(Name(v.to_string()))
            }
        }
        deserializer.deserialize_any(NameVisitor)
    }
}

/// Points as `[[x, y], …]`.
#[derive(Clone, Debug)]
pub(super) struct Points(pub(super) Vec<Vec2>);

impl<'de> Deserialize<'de> for Points {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let points = Vec::<[Number; 2]>::deserialize(deserializer)?;
        Ok(Self(points.into_iter().map(point).collect()))
    }
}

/// Builds a point. Null coordinates become NaN, which is refused later with the path of the field.
fn point([x, y]: [Number; 2]) -> Vec2 {
    Vec2::new(x.or_nan(), y.or_nan())
}

/// A polygon: its exterior alone, or `{"exterior", "holes"}`.
#[derive(Clone, Debug)]
pub(super) struct Area(pub(super) Polygon);

impl<'de> Deserialize<'de> for Area {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(serde::Deserialize)]
        struct Rings {
            exterior: Points,
            holes: Option<Vec<Points>>,
        }

        struct AreaVisitor;
        impl<'de> Visitor<'de> for AreaVisitor {
            type Value = Area;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a ring of points, or an object with `exterior` and `holes`")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Area, A::Error> {
                let Points(exterior) = Deserialize::deserialize(SeqAccessDeserializer::new(seq))?;
                Ok(Area(Polygon { exterior, holes: Vec::new() }))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Area, A::Error> {
                let Rings { exterior, holes } = Deserialize::deserialize(MapAccessDeserializer::new(map))?;
                let holes = holes.unwrap_or_default().into_iter().map(|ring| ring.0).collect();
                Ok(Area(Polygon { exterior: exterior.0, holes }))
            }
        }
        deserializer.deserialize_any(AreaVisitor)
    }
}

/// Puts quotes around the words NaN, Infinity and -Infinity outside of strings. They are not valid JSON, but
/// common writers produce them. When quoted, they are refused with the name of their field instead of a
/// column number.
pub(crate) fn quote_not_finite(text: &str) -> Cow<'_, str> {
    if !(text.contains("NaN") || text.contains("Infinity")) {
        return Cow::Borrowed(text);
    }
    let mut quoted = String::with_capacity(text.len() + 64);
    let mut rest = text;
    while let Some(i) = rest.find(['"', 'N', 'I', '-']) {
        quoted.push_str(&rest[..i]);
        rest = &rest[i..];
        let word = ["NaN", "Infinity", "-Infinity"].into_iter().find(|w| rest.starts_with(w));
        let taken = if let Some(word) = word {
            quoted.push('"');
            quoted.push_str(word);
            quoted.push('"');
            word.len()
        } else {
            let taken = if rest.starts_with('"') { string_length(rest) } else { 1 };
            quoted.push_str(&rest[..taken]);
            taken
        };
        rest = &rest[taken..];
    }
    quoted.push_str(rest);
    Cow::Owned(quoted)
}

/// Returns the length in bytes of the string literal at the start of `text`, including the quotes.
fn string_length(text: &str) -> usize {
    let mut escaped = false;
    for (i, byte) in text.bytes().enumerate().skip(1) {
        match byte {
            _ if escaped => escaped = false,
            b'\\' => escaped = true,
            b'"' => return i + 1,
            _ => {}
        }
    }
    text.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotes_words_that_are_not_json() {
        let text = r#"{"NaN": [NaN, -Infinity, Infinity, -1, "a \" NaN"]}"#;
        let expected = r#"{"NaN": ["NaN", "-Infinity", "Infinity", -1, "a \" NaN"]}"#;
        assert_eq!(quote_not_finite(text), expected);
        assert!(matches!(quote_not_finite("[1, 2]"), Cow::Borrowed(_)));
    }
}
