//! Instants as text.

use std::time::{SystemTime, UNIX_EPOCH};

/// Source of the current time. It is passed in, so that tests can set any time.
pub type Clock = Box<dyn Fn() -> SystemTime + Send>;

/// Returns the system clock.
pub fn system_clock() -> Clock {
    Box::new(SystemTime::now)
}

/// Formats an instant in RFC 3339, UTC, with milliseconds: `2026-03-01T12:00:00.000Z`. Texts of this
/// form sort like the instants. Instants before 1970 become its beginning.
pub fn rfc3339(time: SystemTime) -> String {
    let since = time.duration_since(UNIX_EPOCH).unwrap_or_default();
    let (days, second) = (since.as_secs() / 86_400, since.as_secs() % 86_400);
    let (year, month, day) = civil(days);
    format!(
        "{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}.{:03}Z",
        second / 3600,
        second / 60 % 60,
        second % 60,
        since.subsec_millis()
    )
}

/// Returns whether a text is an instant as written by [`rfc3339`].
pub fn is_rfc3339(text: &str) -> bool {
    let shape = b"dddd-dd-ddTdd:dd:dd.dddZ";
    let fits = |(found, expected): (u8, &u8)| match expected {
        b'd' => found.is_ascii_digit(),
        other => found == *other,
    };
    let in_range = |from: usize, low: u8, high: u8| {
        text.get(from..from + 2).and_then(|t| t.parse().ok()).is_some_and(|n: u8| (low..=high).contains(&n))
    };
    text.len() == shape.len()
        && text.bytes().zip(shape).all(fits)
        && in_range(5, 1, 12)
        && in_range(8, 1, 31)
        && in_range(11, 0, 23)
        && in_range(14, 0, 59)
        && in_range(17, 0, 60)
}

/// Returns year, month and day of a day counted from 1970-01-01 (Howard Hinnant, "chrono-Compatible
/// Low-Level Date Algorithms").
fn civil(days: u64) -> (u64, u64, u64) {
    // Eras of 400 years are equal; years that begin in March have their leap day at the end.
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 { shifted_month + 3 } else { shifted_month - 9 };
    (year_of_era + era * 400 + u64::from(month <= 2), month, day)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn instants_are_written_in_rfc_3339() {
        let text = |ms: u64| rfc3339(UNIX_EPOCH + Duration::from_millis(ms));
        assert_eq!(text(0), "1970-01-01T00:00:00.000Z");
        assert_eq!(text(951_782_399_999), "2000-02-28T23:59:59.999Z");
        assert_eq!(text(951_782_400_000), "2000-02-29T00:00:00.000Z");
        assert_eq!(text(1_772_366_400_007), "2026-03-01T12:00:00.007Z");
        assert!(is_rfc3339(&text(1_772_366_400_007)));
        for bad in ["", "2026-03-01T12:00:00Z", "2026-13-01T12:00:00.000Z", "2026-03-01T12:00:00.000z"] {
            assert!(!is_rfc3339(bad), "{bad}");
        }
    }
}
