//! Decision on the layout of all files, and their trajectories under it.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use reactsim_scene::AgentState;

use super::content::Content;
use super::layout::{Choice, Layout};
use super::logs::Located;
use super::tally::{HeadingTally, LayoutTally, MISFIT, Total, are_same};
use super::track::{Heading, Slip, slip, states};

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
pub enum Undecided {
    /// None fits nearly all files.
    #[error(
        "no array continues the logged AV in nearly all of {files} files; those that do so in some:\n\
         {listed}{options}"
    )]
    None {
        /// Number of files.
        files: usize,
        /// The best layouts.
        listed: String,
        /// Content of a file, and options.
        options: String,
    },
    /// Several fit.
    #[error("several layouts fit equally well, with different trajectories:\n{listed}{options}")]
    Several {
        /// The layouts.
        listed: String,
        /// Content of a file, and options.
        options: String,
    },
}

/// Reads all files and tests them under all layouts; files that cannot be read go to `refused` with the
/// reason.
pub fn measure(
    files: Vec<Located>,
    choice: &Choice,
    refused: &mut Vec<(PathBuf, String)>,
) -> (Vec<Located>, LayoutTally) {
    let one = |file: &Located| {
        let content = Content::read(&file.path).map_err(|error| error.cause.to_string())?;
        Ok::<_, String>(Layout::fitting(&content, &file.windows, choice))
    };
    let all: Vec<_> = files.par_iter().map(one).collect();
    let (mut read, mut tally) = (Vec::new(), LayoutTally::default());
    for (file, fitting) in files.into_iter().zip(all) {
        match fitting {
            Ok(fitting) => {
                tally.add(fitting);
                read.push(file);
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
pub fn decide(files: &[Located], tally: &LayoutTally, choice: &Choice) -> Result<Decided, Undecided> {
    let example = files.first().map_or(Path::new(""), |file| &file.path);
    let rivals = tally.best().map_err(|best| {
        let listed: String = best.iter().map(line).collect();
        let listed = if listed.is_empty() { "  none\n".to_owned() } else { listed };
        Undecided::None { files: files.len(), listed, options: options(example) }
    })?;
    let headings = headings(files, &rivals, choice);
    let one = |file: &Located| {
        let (content, windows) = (Content::read(&file.path).unwrap_or_default(), &file.windows);
        let of = |((layout, _), heading): (&(Layout, Total), &Heading)| {
            let fit = layout.fit(&content, windows);
            let states = fit.and_then(|_| states(&content, windows, layout, *heading));
            let slip = slip(&content, windows, layout, *heading);
            Trial { cost: fit.map_or(MISFIT, |fit| fit.cost), states, slip }
        };
        rivals.iter().zip(&headings).map(of).collect::<Vec<_>>()
    };
    let tracks: Vec<Vec<Trial>> = files.par_iter().map(one).collect();
    let moves_otherwise = |at: &usize| {
        let mut slip = Slip::default();
        tracks.iter().for_each(|file| slip.add(&file[*at].slip));
        slip.point().is_some_and(|point| point != rivals[*at].0.point)
    };
    let mut left: Vec<usize> = (0..rivals.len()).filter(|at| !moves_otherwise(at)).collect();
    if left.is_empty() {
        left = (0..rivals.len()).collect();
    }
    // In the frame of the AV only its speed shows when a trajectory begins.
    let first = left[0];
    let begins_otherwise = |at: usize| {
        let costs = tracks.iter().map(|file| file[at].cost - file[first].cost);
        rivals[at].0.sample != rivals[first].0.sample && is_above_zero(costs)
    };
    left.retain(|at| !begins_otherwise(*at));
    let best = left[0];
    let differs = |at: usize| {
        let pairs = tracks.iter().map(|file| (file[best].states.as_deref(), file[at].states.as_deref()));
        rivals[at].0.sample != rivals[best].0.sample || !are_same(pairs)
    };
    let others: Vec<usize> = left.into_iter().skip(1).filter(|at| differs(*at)).collect();
    if !others.is_empty() {
        let listed = std::iter::once(best).chain(others).map(|at| line(&rivals[at])).collect();
        return Err(Undecided::Several { listed, options: options(example) });
    }
    let (layout, total) = rivals[best].clone();
    let tracks = tracks.into_iter().map(|mut file| file.swap_remove(best).states).collect();
    let [rows, columns] = total.shape;
    let about = format!("{rows} × {columns}, {layout}, {}", headings[best]);
    Ok(Decided { about, layout, tracks })
}

/// A file under a layout.
struct Trial {
    cost: f64,
    states: Option<Vec<AgentState>>,
    slip: Slip,
}

/// Returns whether the mean of numbers is above zero beyond chance, and by more than 2 cm.
fn is_above_zero(numbers: impl Iterator<Item = f64>) -> bool {
    let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
    for number in numbers {
        (sum, squares, count) = (sum + number, squares + number * number, count + 1.0);
    }
    let mean = sum / count;
    let error = ((squares / count - mean * mean).max(0.0) / f64::max(count - 1.0, 1e-9)).sqrt();
    mean > f64::max(0.02, 3.0 * error)
}

/// Returns the place of the headings under each layout.
fn headings(files: &[Located], rivals: &[(Layout, Total)], choice: &Choice) -> Vec<Heading> {
    let one = |file: &Located| {
        let content = Content::read(&file.path).unwrap_or_default();
        let of = |(layout, _): &(Layout, Total)| Heading::fitting(&content, &file.windows, layout, choice);
        rivals.iter().map(of).collect::<Vec<_>>()
    };
    let mut tallies: Vec<HeadingTally> = rivals.iter().map(|_| HeadingTally::default()).collect();
    for file in files.par_iter().map(one).collect::<Vec<_>>() {
        tallies.iter_mut().zip(file).for_each(|(tally, fitting)| tally.add(&fitting));
    }
    tallies.iter().map(HeadingTally::best).collect()
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
    text + "State what is meant with --array KEY, --columns x,y,heading, --frame global, --pose rear-axle, \
            --first-frame 11, --step 0.1 or --sample current"
}
