//! The numbers in a file, whatever its containers: tables that may be trajectories.

use std::collections::BTreeMap;
use std::path::Path;

use reactsim_scene::Deviation;

use crate::error::{Cause, FormatError};
use crate::format::read_whole;
use crate::pickle::{Grid, Pickle, View};

/// Maximum file size in bytes; a cache of a whole scene has some megabytes.
const MAX_FILE_SIZE: u64 = 1 << 27;
/// Fewest entries of a trajectory: 8 s at 2 Hz.
const MIN_ROWS: usize = 16;
/// Most entries of a trajectory.
const MAX_ROWS: usize = 1000;
/// Most columns of an entry.
const MAX_COLUMNS: usize = 32;
/// Most trajectories of an array.
const MAX_SLOTS: usize = 128;
/// Most containers within one another.
const MAX_DEPTH: usize = 12;
/// Most values of a container that are looked at.
const MAX_VALUES: usize = 512;
/// Most origins of coordinates that are tried.
const MAX_ORIGINS: usize = 32;
/// Most values that are described to a person.
const MAX_DESCRIBED: usize = 16;
/// Words in the names of categories, and words beside a category in a text that states one.
const CATEGORY: &[&str] =
    &["behavior", "behaviour", "category", "class", "deviation", "kind", "label", "type"];
const BESIDE: &[&str] =
    &["av", "avs", "category", "deviated", "deviation", "deviations", "scenarios", "type"];
/// Names of the index of the AV among the agents of a file.
const AV_INDEX: &[&str] = &["av_index", "av_idx", "ego_index", "ego_idx", "sdc_index", "sdc_track_index"];

#[derive(Debug, Default)]
pub(super) struct Content {
    /// Tables that may be trajectories.
    pub(super) tables: Vec<Table>,
    /// Index of the AV among the agents.
    pub(super) av: Option<usize>,
    /// Numbers that may be the origin of coordinates (x, y and, last, a heading), with their keys.
    pub(super) origins: Vec<(String, Vec<f64>)>,
    /// Category that the file states.
    pub(super) category: Option<Deviation>,
    /// What the file contains, for a person.
    pub(super) outline: Vec<String>,
}

/// Rows of numbers, for one trajectory or several (slots).
#[derive(Clone, Debug)]
pub(super) struct Table {
    /// Path in the file.
    pub(super) key: String,
    pub(super) slots: usize,
    pub(super) rows: usize,
    pub(super) names: Vec<String>,
    numbers: Vec<f64>,
}

impl Table {
    /// Returns a number; NaN if it does not exist.
    pub(super) fn at(&self, slot: usize, row: usize, column: usize) -> f64 {
        let at = (slot * self.rows + row) * self.names.len() + column;
        self.numbers.get(at).copied().unwrap_or(f64::NAN)
    }

    fn of(view: &View<'_>, key: &str, grids: &[Grid<'_>], turned: bool) -> Option<Self> {
        let first = grids.first()?;
        let (rows, columns) = if turned { (first.columns, first.rows) } else { (first.rows, first.columns) };
        let is_possible = (MIN_ROWS..=MAX_ROWS).contains(&rows) && columns <= MAX_COLUMNS;
        if !is_possible || grids.len() > MAX_SLOTS {
            return None;
        }
        // Many references to one array are as many copies.
        view.spend(grids.len() * rows * columns).ok()?;
        let mut numbers = Vec::with_capacity(grids.len() * rows * columns);
        for grid in grids {
            for row in 0..rows {
                numbers.extend((0..columns).map(|c| if turned { grid.at(c, row) } else { grid.at(row, c) }));
            }
        }
        let names = (0..columns).map(|c| c.to_string()).collect();
        Some(Self { key: key.to_owned(), slots: grids.len(), rows, names, numbers })
    }

    /// Appends the columns of tables with as many rows.
    fn with(&self, others: &[&Self]) -> Self {
        let names = self.names.iter().chain(others.iter().flat_map(|other| &other.names)).cloned().collect();
        let mut numbers = Vec::new();
        for i in 0..self.slots * self.rows {
            for table in std::iter::once(&self).chain(others) {
                let columns = table.names.len();
                numbers.extend(&table.numbers[i * columns..(i + 1) * columns]);
            }
        }
        Self { key: self.key.clone(), slots: self.slots, rows: self.rows, names, numbers }
    }
}

/// What was found in one container: tables of several columns, and columns with their names.
#[derive(Default)]
struct Scope {
    tables: Vec<Table>,
    columns: Vec<Table>,
}

impl Content {
    /// Reads a file.
    ///
    /// # Errors
    /// [`FormatError`] if the file is no pickle, or one that tries to run code.
    pub(super) fn read(path: &Path) -> Result<Self, FormatError> {
        let file = read_whole(path, MAX_FILE_SIZE, "one scenario")?;
        let refuse = |text| FormatError::file(path, Cause::Undecodable(format!("as a pickle: {text}")));
        let pickle = Pickle::read_objects(&file).map_err(refuse)?;
        let (mut content, mut scope) = (Self::default(), Scope::default());
        content.look(&pickle.root(), "", 0, &mut scope);
        content.join(scope, "");
        number_repeated(content.tables.iter_mut().map(|table| &mut table.key));
        number_repeated(content.origins.iter_mut().map(|(key, _)| key));
        Ok(content)
    }

    /// Looks at a value and all within it; tables and columns of this value itself go to `scope`.
    fn look(&mut self, view: &View<'_>, name: &str, depth: usize, scope: &mut Scope) {
        let key = anonymous(view.path());
        if let Some(text) = view.as_text() {
            let is_stated =
                name.starts_with('[') || words(name).any(|word| CATEGORY.contains(&word.as_str()));
            self.category = self.category.or_else(|| category_in(text).filter(|_| is_stated));
            return;
        }
        if let Ok(number) = view.number() {
            if AV_INDEX.contains(&name) && number >= 0.0 {
                self.av = Some(number as usize);
            }
            return;
        }
        let grids = grids_of(view);
        if !grids.is_empty() {
            return self.found(view, &key, name, &grids, scope);
        }
        let children = view.children().unwrap_or_default();
        if depth >= MAX_DEPTH || children.is_empty() {
            return;
        }
        let mut inner = Scope::default();
        if children.len() >= MIN_ROWS && view.is_list() {
            inner.columns = records(&key, &children);
        }
        if inner.columns.is_empty() {
            for (name, child) in children.iter().take(MAX_VALUES) {
                self.look(child, name, depth + 1, &mut inner);
            }
        }
        self.join(inner, &key);
    }

    fn found(&mut self, view: &View<'_>, key: &str, name: &str, grids: &[Grid<'_>], scope: &mut Scope) {
        let Some(first) = grids.first() else { return };
        if self.outline.len() < MAX_DESCRIBED {
            let begin: Vec<String> = (0..first.rows.min(2))
                .flat_map(|row| (0..first.columns.min(6)).map(move |column| (row, column)))
                .map(|(row, column)| format!("{:.3}", first.at(row, column)))
                .collect();
            let key = if key.is_empty() { "the file" } else { key };
            self.outline.push(format!("{key}: {} ({} ...)", view.describe(), begin.join(", ")));
        }
        let length = first.rows.saturating_mul(first.columns);
        if grids.len() == 1 && (2..=4).contains(&length) {
            let numbers = (0..length).map(|i| first.at(i / first.columns, i % first.columns)).collect();
            if self.origins.len() < MAX_ORIGINS {
                self.origins.push((key.to_owned(), numbers));
            }
            return;
        }
        let mut column = |table: Option<Table>| {
            scope.columns.extend(table.map(|t| Table { names: vec![name.to_owned()], ..t }));
        };
        if first.columns == 1 {
            return column(Table::of(view, key, grids, false));
        }
        scope.tables.extend(Table::of(view, key, grids, false));
        // One row per agent, or one row per coordinate.
        if grids.len() == 1 && first.rows <= MAX_SLOTS && first.columns >= MIN_ROWS {
            let turned = Table::of(view, key, grids, true);
            column(turned.clone().map(|t| {
                let numbers = (0..first.rows).flat_map(|r| (0..first.columns).map(move |c| first.at(r, c)));
                Table { slots: first.rows, numbers: numbers.collect(), ..t }
            }));
            if first.rows >= 2 {
                scope.tables.extend(turned.map(|t| Table { key: format!("{key}.T"), ..t }));
            }
        }
    }

    /// Joins what a container holds: positions with headings and other columns, and x with y.
    fn join(&mut self, scope: Scope, key: &str) {
        let fits = |table: &Table, column: &Table| (table.slots, table.rows) == (column.slots, column.rows);
        for table in &scope.tables {
            let others: Vec<&Table> = scope.columns.iter().filter(|c| fits(table, c)).collect();
            let is_bare = table.names.len() <= 3 && others.len() <= MAX_COLUMNS;
            self.tables.push(if is_bare { table.with(&others) } else { table.clone() });
        }
        for x in &scope.columns {
            let name = &x.names[0];
            let Some(stem) = name.strip_suffix(['x', 'X']) else { continue };
            let is_y = |c: &&Table| c.names[0].strip_suffix(['y', 'Y']) == Some(stem) && fits(x, c);
            let Some(y) = scope.columns.iter().find(is_y) else { continue };
            let others =
                scope.columns.iter().filter(|c| fits(x, c) && c.names != x.names && c.names != y.names);
            let others: Vec<&Table> = std::iter::once(y).chain(others.take(MAX_COLUMNS)).collect();
            let key = [key, &format!("{name},{}", y.names[0])].join(if key.is_empty() { "" } else { "." });
            self.tables.push(Table { key, ..x.with(&others) });
        }
    }
}

/// Returns the columns of a list of records with the same numbers; none if it is no such list.
fn records(key: &str, items: &[(String, View<'_>)]) -> Vec<Table> {
    let mut columns: Vec<Table> = Vec::new();
    for (row, (_, item)) in items.iter().enumerate() {
        let mut numbers = Vec::new();
        leaves(item, "", 0, &mut numbers);
        if row == 0 {
            let column = |(name, _): &(String, f64)| Table {
                key: key.to_owned(),
                slots: 1,
                rows: items.len(),
                names: vec![name.clone()],
                numbers: Vec::new(),
            };
            columns = numbers.iter().take(2 * MAX_COLUMNS).map(column).collect();
        }
        for column in &mut columns {
            let Some((_, number)) = numbers.iter().find(|(name, _)| *name == column.names[0]) else {
                return Vec::new();
            };
            column.numbers.push(*number);
        }
    }
    columns
}

/// Finds the numbers in a record and in the records within it, with their names.
fn leaves(view: &View<'_>, name: &str, depth: usize, found: &mut Vec<(String, f64)>) {
    if let Ok(number) = view.number() {
        return found.push((name.to_owned(), number));
    }
    let dotted = |inner: &str| if name.is_empty() { inner.to_owned() } else { format!("{name}.{inner}") };
    if (view.shape().is_some() || view.is_list())
        && let Ok(grid) = view.grid()
        && (2..=4).contains(&(grid.rows * grid.columns))
    {
        let at = |i: usize| grid.at(i / grid.columns, i % grid.columns);
        return found.extend(
            ["x", "y", "2", "3"]
                .iter()
                .take(grid.rows * grid.columns)
                .enumerate()
                .map(|(i, n)| (dotted(n), at(i))),
        );
    }
    if depth < MAX_DEPTH && view.is_dict() {
        for (inner, child) in view.children().unwrap_or_default().iter().take(MAX_COLUMNS) {
            leaves(child, &dotted(inner), depth + 1, found);
        }
    }
}

/// Returns the planes of an array, or of a list of numbers, of rows or of tables with the same sides; none if
/// the value is none of these.
fn grids_of<'a>(view: &View<'a>) -> Vec<Grid<'a>> {
    if let Some([planes, ..]) = view.shape() {
        return (0..planes.min(MAX_SLOTS + 1)).filter_map(|i| view.plane(i).ok()).collect();
    }
    let items = if view.is_list() { view.items().unwrap_or_default() } else { Vec::new() };
    let is_flat = |item: &View<'_>| item.shape().is_none_or(|[planes, ..]| planes == 1);
    let table = |item: &View<'a>| item.grid().ok().filter(|g| is_flat(item) && g.rows > 1 && g.columns > 1);
    let tables: Vec<Grid<'a>> = items.iter().map_while(table).collect();
    let sides = |grid: &Grid<'_>| [grid.rows, grid.columns];
    match tables.first().map(sides) {
        Some(first) if tables.len() == items.len() && tables.iter().all(|t| sides(t) == first) => tables,
        None if items.iter().all(is_flat) => view.grid().into_iter().filter(|grid| grid.rows > 0).collect(),
        _ => Vec::new(),
    }
}

/// Numbers keys that occur again, as those of several tokens do.
fn number_repeated<'a>(keys: impl Iterator<Item = &'a mut String>) {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for key in keys {
        let count = counts.entry(key.clone()).or_default();
        *count += 1;
        if *count > 1 {
            *key = format!("{key}#{count}");
        }
    }
}

/// Returns the words of a text in small letters.
fn words(text: &str) -> impl Iterator<Item = String> {
    text.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).map(str::to_lowercase)
}

/// Returns the category that a text states; one that only mentions it, such as a kind of scenario, states none.
pub(super) fn category_in(text: &str) -> Option<Deviation> {
    let is_number = |word: &str| word.bytes().all(|b| b.is_ascii_digit());
    let mut words = words(text).filter(|word| !BESIDE.contains(&word.as_str()) && !is_number(word));
    let category = Deviation::from_name(&words.next()?)?;
    words.next().is_none().then_some(category)
}

/// Replaces names with tokens in a path, which differ from file to file.
fn anonymous(path: &str) -> String {
    let is_token = |part: &str| part.len() == 16 && part.bytes().all(|b| b.is_ascii_hexdigit());
    let is_own = |part: &str| part.split('_').any(is_token);
    path.split('.').map(|part| if is_own(part) { "*" } else { part }).collect::<Vec<_>>().join(".")
}
