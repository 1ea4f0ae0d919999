//! Values for attacks on parameters, and whether they are within a range.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reactsim::models::Allowed;

/// Texts that are not numbers, or are extreme ones.
const ODD: [&str; 15] = [
    "0",
    "-1",
    "-0.0",
    "1e9",
    "-1e308",
    "1e308",
    "5e-324",
    "nan",
    "inf",
    "-inf",
    "",
    "soon",
    "true",
    "9223372036854775807",
    "-9223372036854775808",
];

/// Returns values for a parameter: its bounds, drawn values between them, values just outside, and odd ones.
/// The draws depend on `seed` alone.
pub(super) fn values(allowed: &Allowed, seed: &str) -> Vec<String> {
    let mut rng = ChaCha8Rng::from_seed(*blake3::hash(seed.as_bytes()).as_bytes());
    let mut values = match allowed {
        Allowed::Floats { min, max } => {
            let drawn = [rng.random_range(*min..=*max), rng.random_range(*min..=*max)];
            let outside = [min.next_down(), max.next_up()];
            [&[*min, *max][..], &drawn, &outside].concat().iter().map(|x| format!("{x:?}")).collect()
        }
        Allowed::Integers { min, max } => {
            let drawn = rng.random_range(*min..=*max);
            [*min, *max, drawn, min - 1, max + 1].iter().map(i64::to_string).collect()
        }
        Allowed::Flags => vec!["true".to_owned(), "false".to_owned(), "1".to_owned()],
        Allowed::Texts(texts) => texts.clone(),
    };
    values.extend(ODD.map(str::to_owned));
    values.extend(["1.5".to_owned(), "9223372036854775808".to_owned()]);
    values.sort();
    values.dedup();
    values
}

/// Returns whether the text of a value is within a range, without the TOML reader.
pub(super) fn accepts(allowed: &Allowed, value: &str) -> bool {
    match allowed {
        Allowed::Floats { min, max } => value.parse().is_ok_and(|x: f64| *min <= x && x <= *max),
        Allowed::Integers { min, max } => value.parse().is_ok_and(|n: i64| *min <= n && n <= *max),
        Allowed::Flags => value == "true" || value == "false",
        Allowed::Texts(texts) => texts.iter().any(|text| text == value),
    }
}
