//! Times with their unit.

use std::fmt::{self, Display, Formatter};
use std::str::FromStr;
use std::time::Duration;

/// The longest time: the clock can be that far ahead.
const MOST: Duration = Duration::from_secs(365 * 24 * 3600);

/// A time of at most 365 days, such as `90s`, `3m` or `1h`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Time(pub Duration);

impl FromStr for Time {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is not a time: write a number with its unit, such as 90s, 3m or 1h");
        let (number, unit) = text.split_at_checked(text.len().saturating_sub(1)).ok_or_else(wrong)?;
        let seconds = match unit {
            "s" => 1.0,
            "m" => 60.0,
            "h" => 3600.0,
            _ => return Err(wrong()),
        };
        let number: f64 = number.parse().map_err(|_| wrong())?;
        let time = Duration::try_from_secs_f64(number * seconds).map_err(|_| wrong())?;
        match time <= MOST {
            true => Ok(Self(time)),
            false => Err(format!("`{text}` is too long: write a time of at most 8760h, which are 365 days")),
        }
    }
}

impl Display for Time {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}s", self.0.as_secs_f64())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_at_most_a_year() {
        assert_eq!("8760h".parse(), Ok(Time(MOST)));
        for (text, part) in [("8761h", "at most 8760h"), ("1e30s", "not a time"), ("-1s", "not a time")] {
            assert!(text.parse::<Time>().unwrap_err().contains(part), "{text}");
        }
    }
}
