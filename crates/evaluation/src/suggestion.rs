//! Suggestions for misspelt names.

use std::fmt::Display;

/// Returns the most similar of the known names, if one is similar enough: one different or swapped character,
/// and one more for every five.
pub fn most_similar<T: AsRef<str>>(name: &str, known: impl IntoIterator<Item = T>) -> Option<T> {
    let length = name.chars().count();
    let distance = |known: &T| strsim::damerau_levenshtein(name, known.as_ref());
    let candidates = known.into_iter().map(|known| (distance(&known), known));
    let similar = candidates.filter(|(distance, _)| (1..=1 + length / 5).contains(distance));
    // The first of equally similar ones.
    similar.min_by_key(|(distance, _)| *distance).map(|(_, known)| known)
}

/// Returns the end of a sentence that suggests the most similar of the known names; empty if none is similar.
pub fn did_you_mean<T: AsRef<str>>(name: &str, known: impl IntoIterator<Item = T>) -> String {
    most_similar(name, known)
        .map_or_else(String::new, |known| format!("; did you mean `{}`?", known.as_ref()))
}

/// Returns the beginning of a hint that suggests a name; empty without one.
pub fn question(meant: Option<impl Display>) -> String {
    meant.map_or_else(String::new, |meant| format!("did you mean `{meant}`? "))
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: [&str; 3] = ["idm", "ntp-reactive", "qp-regression"];

    #[test]
    fn similar_names_are_suggested() {
        assert_eq!(most_similar("imd", NAMES), Some("idm"));
        assert_eq!(most_similar("ntp_reactive", NAMES), Some("ntp-reactive"));
        assert_eq!(did_you_mean("qp-regresion", NAMES), "; did you mean `qp-regression`?");
    }

    #[test]
    fn other_names_are_not_suggested() {
        assert_eq!(most_similar("mtr", NAMES), None);
        assert_eq!(did_you_mean("", NAMES), "");
    }
}
