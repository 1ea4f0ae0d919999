//! Recognition of tf.Example records, the other form in which the data set is published.

use super::size::Fields;

/// Tag of the features of a `tf.Example`, of each feature in them, and of its name.
const TAG: u64 = 1;
/// Number of features that are looked at.
const EXAMINED_FEATURES: usize = 4;

/// Returns whether a message is a `tf.Example`: nothing but a map of named features. The first field of a
/// `Scenario` are times, and other fields follow.
pub(super) fn is_example(payload: &[u8]) -> bool {
    let mut fields = Fields(payload);
    let (Some((TAG, features)), None) = (fields.next(), fields.next()) else { return false };
    let is_named = |feature: &[u8]| {
        let name = Fields(feature).next();
        name.is_some_and(|(tag, name)| tag == TAG && !name.is_empty() && name.is_ascii())
    };
    let mut examined = Fields(features).take(EXAMINED_FEATURES).peekable();
    examined.peek().is_some() && examined.all(|(tag, feature)| tag == TAG && is_named(feature))
}
