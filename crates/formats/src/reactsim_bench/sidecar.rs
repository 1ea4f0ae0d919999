//! Categories beside the files: in the names of folders, and in lists.

use std::collections::BTreeMap;
use std::path::Path;

use reactsim_scene::Deviation;

use super::BenchName;
use super::content::category_in;

/// Returns the category that the innermost folder above a file, or its name, states.
pub fn category_of_path(path: &Path) -> Option<Deviation> {
    path.ancestors().find_map(|part| category_in(&part.file_name()?.to_string_lossy()))
}

/// Reads a list of any format of names of files and their categories, each before or each after its names, by
/// the stem of the file name.
pub fn sidecar(text: &str) -> BTreeMap<String, Deviation> {
    let (mut found, mut waiting, mut last, mut is_first) = (BTreeMap::new(), Vec::new(), None, None);
    for word in text.split(|c: char| !(c.is_alphanumeric() || "_-./".contains(c))) {
        let path = Path::new(word);
        if BenchName::of(path).is_ok() {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let follows = *is_first.get_or_insert(false);
            match last.filter(|_| follows) {
                Some(category) => drop(found.insert(stem, category)),
                None => waiting.push(stem),
            }
        } else if let Some(category) = category_in(word) {
            last = Some(category);
            is_first.get_or_insert(true);
            found.extend(waiting.drain(..).map(|stem| (stem, category)));
        }
    }
    found
}
