//! Recognition of tf.Example records, the other form in which the data set is published.

use crate::wire::Fields;

/// Tag of the features of a `tf.Example`, of each feature in them, and of its name.
const TAG: u32 = 1;
/// Number of features that are looked at.
const EXAMINED_FEATURES: usize = 4;

/// Returns whether a message is a `tf.Example`: nothing but a map of named features. The first field of a
/// `Scenario` are times, and other fields follow.
pub(super) fn is_example(payload: &[u8]) -> bool {
    let mut fields = Fields::new(payload);
    let (Ok(Some((TAG, features))), Ok(None)) = (fields.next_content(), fields.next_content()) else {
        return false;
    };
    let is_named = |feature: &[u8]| {
        let name = Fields::new(feature).next_content();
        matches!(name, Ok(Some((TAG, name))) if !name.is_empty() && name.is_ascii())
    };
    let mut features = Fields::new(features);
    let mut examined =
        std::iter::from_fn(|| features.next_content().ok()?).take(EXAMINED_FEATURES).peekable();
    examined.peek().is_some() && examined.all(|(tag, feature)| tag == TAG && is_named(feature))
}
