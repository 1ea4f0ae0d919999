//! Decision on the layout of all files, and their trajectories under it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use reactsim_scene::AgentState;

use super::content::Content;
use super::layout::{Choice, Layout};
use super::logs::Located;
use super::tally::{MISFIT, Tally, Total, is_same};
use super::track::{Heading, states};

/// Fewest files whose costs show which of two readings of an array is right.
const FEWEST: f64 = 5.0;
/// Most layouts that are listed.
const MAX_LISTED: usize = 12;

/// Layout of all files.
#[derive(Debug)]
pub struct Decided {
    /// What it is, for a person.
    pub about: String,
    /// The layout.
    pub layout: Layout,
    /// States at steps 1 to 80 of each file; `None` if it does not fit.
    pub tracks: Vec<Option<Vec<AgentState>>>,
}

/// Why no layout is taken.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Undecided(pub String);

/// Reads all files and tests them under all layouts; files that cannot be read go to `refused` with the
/// reason.
pub fn measure(
    files: Vec<Located>,
    choice: &Choice,
    refused: &mut Vec<(PathBuf, String)>,
) -> (Vec<Located>, Tally<Layout>) {
    let one = |file: &Located| {
        let content = Content::read(&file.path).map_err(|error| error.cause.to_string())?;
        Ok::<_, String>((Layout::fitting(&content, &file.windows, choice), content.category))
    };
    let all: Vec<_> = files.par_iter().map(one).collect();
    let (mut read, mut tally) = (Vec::new(), Tally::default());
    for (file, fitting) in files.into_iter().zip(all) {
        match fitting {
            Ok((fitting, category)) => {
                tally.add(fitting);
                read.push(Located { category, ..file });
            }
            Err(reason) => refused.push((file.path, reason)),
        }
    }
    (read, tally)
}

/// Decides on the layout of files that can be read.
///
/// # Errors
/// [`Undecided`] shows what the files contain and which options decide.
pub fn decide(files: &[Located], tally: &Tally<Layout>, choice: &Choice) -> Result<Decided, Undecided> {
    let example = files.first().map_or(Path::new(""), |file| &file.path);
    let rivals = tally.best().map_err(|best| {
        let listed: String = best.iter().take(MAX_LISTED).map(line).collect();
        let listed = if listed.is_empty() { "  none\n".to_owned() } else { listed };
        Undecided(format!(
            "no array continues the logged AV in nearly all of {} files; those that do so in some:\n{listed}{}",
            files.len(),
            options(example)
        ))
    })?;
    let headings = headings(files, &rivals, choice);
    // The trajectory of a file under the best layout; by how much each costs more, and whether it is the same.
    let one = |file: &Located| {
        let (content, windows) = (Content::read(&file.path).unwrap_or_default(), &file.windows);
        let of = |((layout, _), heading): (&(Layout, Total), &Heading)| {
            let cost = layout.fit(&content, windows).map(|fit| fit.cost);
            (cost.unwrap_or(MISFIT), cost.and_then(|_| states(&content, windows, layout, *heading)))
        };
        let mut trials: Vec<(f64, Option<Vec<AgentState>>)> = rivals.iter().zip(&headings).map(of).collect();
        let (least, best) = (trials[0].0, trials[0].1.as_deref());
        let more: Vec<(f64, bool)> =
            trials.iter().map(|(cost, states)| (cost - least, is_same(best, states.as_deref()))).collect();
        (trials.swap_remove(0).1, more)
    };
    let (tracks, more): (Vec<_>, Vec<_>) = files.par_iter().map(one).collect::<Vec<_>>().into_iter().unzip();
    let (layout, total) = &rivals[0];
    let is_rival = |at: &usize| {
        let other = &rivals[*at].0;
        let is_other_sample = other.sample != layout.sample;
        // In the frame of the AV only its speed shows when a trajectory begins, and only bends show which point
        // of the AV it is.
        let is_same_array = (&other.key, other.slot) == (&layout.key, layout.slot);
        let is_worse = is_same_array && is_clear(more.iter().map(|file| file[*at].0));
        let different = more.iter().filter(|file| !file[*at].1).count();
        !is_worse && (is_other_sample || 50 * different >= files.len())
    };
    let others: Vec<usize> = (1..rivals.len()).filter(is_rival).collect();
    if !others.is_empty() {
        let listed = std::iter::once(0).chain(others).take(MAX_LISTED);
        let listed: String = listed.map(|at| line(&rivals[at])).collect();
        return Err(Undecided(format!(
            "several layouts fit equally well, with different trajectories:\n{listed}{}",
            options(example)
        )));
    }
    let [rows, columns] = total.shape;
    let about = format!("{rows} × {columns}, {layout}, {}", headings[0]);
    Ok(Decided { about, layout: layout.clone(), tracks })
}

/// Returns whether the mean of numbers is above zero beyond chance, and by more than 2 cm.
pub(super) fn is_clear(numbers: impl Iterator<Item = f64>) -> bool {
    let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
    for number in numbers {
        (sum, squares, count) = (sum + number, squares + number * number, count + 1.0);
    }
    let mean = sum / count;
    let error = ((squares / count - mean * mean).max(0.0) / (count - 1.0)).sqrt();
    count >= FEWEST && mean > f64::max(0.02, 3.0 * error)
}

/// Returns the place of the headings under each layout.
fn headings(files: &[Located], rivals: &[(Layout, Total)], choice: &Choice) -> Vec<Heading> {
    let one = |file: &Located| {
        let content = Content::read(&file.path).unwrap_or_default();
        let of = |(layout, _): &(Layout, Total)| Heading::fitting(&content, &file.windows, layout, choice);
        rivals.iter().map(of).collect::<Vec<_>>()
    };
    let mut tallies: Vec<Tally<Heading>> = rivals.iter().map(|_| Tally::default()).collect();
    for file in files.par_iter().map(one).collect::<Vec<_>>() {
        tallies.iter_mut().zip(file).for_each(|(tally, fitting)| tally.add(fitting));
    }
    tallies.iter().map(Tally::<Heading>::best).collect()
}

fn line((layout, total): &(Layout, Total)) -> String {
    let is_log = if 2 * total.logs > total.files { "; it is the logged drive" } else { "" };
    let [rows, columns] = total.shape;
    format!("  {rows} × {columns}, {layout}: fits {}{is_log}\n", total.files)
}

/// Returns what a file contains, and the options that state its layout.
fn options(path: &Path) -> String {
    let mut text = format!("{} contains:\n", path.display());
    let outline = Content::read(path).map(|content| content.outline).unwrap_or_default();
    if outline.is_empty() {
        text.push_str("  no numbers in rows\n");
    }
    for line in outline {
        writeln!(text, "  {line}").ok();
    }
    text + "State what is meant: `array` KEY, `columns` x,y,heading, `frame` global, `pose` rear-axle or `sample` \
            current"
}
