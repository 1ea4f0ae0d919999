//! Values of a pickle with their paths, for error messages.

use reactsim_geometry::Vec2;

use super::array::{Array, Content, Grid, Kind, Numbers};
use super::{Id, Node, Pickle};
use crate::error::Cause;

/// Maximum number of keys of a dictionary for lookups by key; larger ones are not records.
const MAX_KEYS: usize = 4096;
/// Maximum number of items of a list; larger tables are arrays.
const MAX_ITEMS: usize = 100_000;
/// Maximum length of an id in bytes.
const MAX_ID_LENGTH: usize = 256;

/// A value and its path.
#[derive(Clone)]
pub(crate) struct View<'a> {
    pickle: &'a Pickle<'a>,
    id: Id,
    path: String,
}

impl<'a> View<'a> {
    pub(super) fn new(pickle: &'a Pickle<'a>, id: Id, path: String) -> Self {
        Self { pickle, id, path }
    }

    /// Returns the path from the outermost value.
    pub(crate) fn path(&self) -> &str {
        &self.path
    }

    /// Returns the error of this value.
    pub(crate) fn wrong(&self, expected: impl Into<String>) -> Cause {
        Cause::value(self.field(), self.describe(), expected)
    }

    fn field(&self) -> String {
        if self.path.is_empty() { "the pickle".into() } else { self.path.clone() }
    }

    fn node(&self) -> &'a Node {
        self.pickle.node(self.id)
    }

    /// Describes the value in a few words.
    pub(crate) fn describe(&self) -> String {
        match self.node() {
            Node::None => "None".into(),
            Node::Bool(b) => b.to_string(),
            Node::Int(i) => i.to_string(),
            Node::Float(v) => v.to_string(),
            Node::Text(range) => {
                let text = String::from_utf8_lossy(self.pickle.bytes(range));
                let begin: String = text.chars().take(60).collect();
                format!("`{}`", begin.escape_debug())
            }
            Node::Bytes(_) | Node::OwnedBytes(_) => "bytes".into(),
            Node::List(all) => format!("a list of {}", all.len()),
            Node::Tuple(all) => format!("a tuple of {}", all.len()),
            Node::Dict(all) => format!("a dictionary of {}", all.len()),
            Node::Global(_) | Node::Dtype(_) | Node::Class(_) => "a type".into(),
            Node::Array(array) => format!("an array of shape {}", array.shown()),
        }
    }

    fn child(&self, id: Id, key: &str) -> Self {
        let path = if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) };
        Self { pickle: self.pickle, id, path }
    }

    /// Subtracts `count` from the budget of the pickle.
    pub(crate) fn spend(&self, count: usize) -> Result<(), Cause> {
        let left = self.pickle.budget.get().checked_sub(count);
        self.pickle.budget.set(left.unwrap_or(0));
        left.map(|_| ()).ok_or_else(|| {
            let found = "one entry too many";
            Cause::value(
                self.field(),
                found,
                "the content of one scenario: at most four million points and entries",
            )
        })
    }

    fn dict(&self) -> Result<&'a [(Id, Id)], Cause> {
        match self.node() {
            Node::Dict(all) => Ok(all),
            _ => Err(self.wrong("a dictionary")),
        }
    }

    /// Returns an entry of a dictionary; `None` if it is missing or is Python's None.
    pub(crate) fn get(&self, key: &str) -> Result<Option<Self>, Cause> {
        let all = self.dict()?;
        if all.len() > MAX_KEYS {
            return Err(self.wrong(format!("a dictionary with the key `{key}` and at most {MAX_KEYS} keys")));
        }
        let found = all.iter().rev().find(|(k, _)| match self.pickle.node(*k) {
            Node::Text(range) | Node::Bytes(range) => self.pickle.bytes(range) == key.as_bytes(),
            _ => false,
        });
        let found = found.map(|(_, value)| self.child(*value, key));
        Ok(found.filter(|v| !matches!(v.node(), Node::None)))
    }

    /// Returns a required entry of a dictionary.
    pub(crate) fn need(&self, key: &str) -> Result<Self, Cause> {
        let missing = || {
            let what =
                if self.path.is_empty() { format!("`{key}`") } else { format!("`{}.{key}`", self.path) };
            Cause::schema(what, "missing", "a scenario as ScenarioNet writes it; convert it again")
        };
        self.get(key)?.ok_or_else(missing)
    }

    /// Returns the entries of a dictionary with their ids, in file order; at most `limit` of them.
    pub(crate) fn entries(&self, limit: usize) -> Result<Vec<(String, Self)>, Cause> {
        let all = self.dict()?;
        if all.len() > limit {
            return Err(self.wrong(format!("at most {limit} entries: those of one scenario")));
        }
        self.spend(all.len())?;
        all.iter()
            .map(|(key, value)| {
                let name = Self::new(self.pickle, *key, format!("a key of {}", self.field())).name()?;
                let path = format!("{}[\"{}\"]", self.path, name.escape_debug());
                Ok((name, Self::new(self.pickle, *value, path)))
            })
            .collect()
    }

    /// Returns the items of a list, a tuple or an array of Python values.
    pub(crate) fn items(&self) -> Result<Vec<Self>, Cause> {
        let all = self.list().ok_or_else(|| self.wrong("a list"))?;
        if all.len() > MAX_ITEMS {
            return Err(self.wrong(format!("a list of at most {MAX_ITEMS} items")));
        }
        self.spend(all.len())?;
        let item = |(i, id): (usize, &Id)| Self::new(self.pickle, *id, format!("{}[{i}]", self.path));
        Ok(all.iter().enumerate().map(item).collect())
    }

    fn list(&self) -> Option<&'a [Id]> {
        match self.node() {
            Node::List(all) | Node::Tuple(all) => Some(all),
            Node::Array(array) => match array.content {
                Content::Value(id) if array.dtype.kind == Kind::Object => match self.pickle.node(id) {
                    Node::List(all) => Some(all),
                    _ => None,
                },
                _ => None,
            },
            _ => None,
        }
    }

    pub(crate) fn is_dict(&self) -> bool {
        matches!(self.node(), Node::Dict(_))
    }

    pub(crate) fn is_none(&self) -> bool {
        matches!(self.node(), Node::None)
    }

    /// Returns whether this is a list, a tuple or an array of Python values.
    pub(crate) fn is_list(&self) -> bool {
        self.list().is_some()
    }

    /// Returns the text; `None` if the value is not a text.
    pub(crate) fn as_text(&self) -> Option<&'a str> {
        match self.node() {
            Node::Text(range) | Node::Bytes(range) => std::str::from_utf8(self.pickle.bytes(range)).ok(),
            _ => None,
        }
    }

    /// Returns the text, or an error if the value is not a text.
    pub(crate) fn text(&self) -> Result<&'a str, Cause> {
        self.as_text().ok_or_else(|| self.wrong("a text"))
    }

    /// Returns an id, which is a text or a whole number.
    pub(crate) fn name(&self) -> Result<String, Cause> {
        if let Node::Int(i) = self.node() {
            self.spend(1)?;
            return Ok(i.to_string());
        }
        let short = |t: &&str| t.len() <= MAX_ID_LENGTH;
        let found = self.as_text().filter(short).ok_or_else(|| {
            self.wrong(format!("an id: a text of at most {MAX_ID_LENGTH} bytes or a whole number"))
        })?;
        // Many entries may refer to one value of the file, and each becomes a separate string.
        self.spend(1 + found.len() / 16)?;
        Ok(found.to_owned())
    }

    pub(crate) fn number(&self) -> Result<f64, Cause> {
        match self.node() {
            Node::Int(i) => Ok(*i as f64),
            Node::Float(v) => Ok(*v),
            Node::Bool(b) => Ok(f64::from(u8::from(*b))),
            _ => Err(self.wrong("a number")),
        }
    }

    /// Returns the whole number, which may be written as a text.
    pub(crate) fn whole(&self) -> Result<i64, Cause> {
        let found = match self.node() {
            Node::Int(i) => Some(*i),
            _ => self.as_text().and_then(|t| t.parse().ok()),
        };
        found.ok_or_else(|| self.wrong("a whole number"))
    }

    /// Returns numbers in rows, from an array, a list of numbers (one column), or a list of rows.
    pub(crate) fn grid(&self) -> Result<Grid<'a>, Cause> {
        match self.node() {
            Node::Array(array) if array.dtype.is_number() => self.array_grid(array, 0),
            _ => self.list_grid(),
        }
    }

    /// Returns the numbers of planes, rows and columns of an array of numbers.
    pub(crate) fn shape(&self) -> Option<[usize; 3]> {
        match self.node() {
            Node::Array(array) if array.dtype.is_number() => Some(array.shape),
            _ => None,
        }
    }

    /// Returns the numbers of a plane of an array.
    pub(crate) fn plane(&self, plane: usize) -> Result<Grid<'a>, Cause> {
        match self.node() {
            Node::Array(array) if plane < array.shape[0] && array.dtype.is_number() => {
                self.array_grid(array, plane)
            }
            _ => Err(self.wrong("an array with this plane")),
        }
    }

    /// Returns the values in a container of any kind, with their keys or indices.
    pub(crate) fn children(&self) -> Result<Vec<(String, Self)>, Cause> {
        if self.is_list() {
            let items = self.items()?.into_iter().enumerate();
            return Ok(items.map(|(i, item)| (format!("[{i}]"), item)).collect());
        }
        let Node::Dict(entries) = self.node() else { return Ok(Vec::new()) };
        self.spend(entries.len())?;
        let entry = |(key, value): &(Id, Id)| {
            let name = Self::new(self.pickle, *key, String::new()).name().ok()?;
            Some((name.clone(), self.child(*value, &name)))
        };
        Ok(entries.iter().filter_map(entry).collect())
    }

    fn array_grid(&self, array: &'a Array, plane: usize) -> Result<Grid<'a>, Cause> {
        let bytes = match &array.content {
            Content::File(range) => self.pickle.bytes(range),
            Content::Value(id) => match self.pickle.node(*id) {
                Node::OwnedBytes(bytes) => bytes,
                _ => return Err(self.wrong("an array with content")),
            },
            Content::Missing => return Err(self.wrong("an array with content")),
        };
        let ([_, rows, columns], [planes, down, across]) = (array.shape, array.strides);
        let start = array.start + plane * planes * array.dtype.size;
        let numbers = Numbers::Raw { bytes, dtype: array.dtype, start, strides: [down, across] };
        Ok(Grid { rows, columns, numbers })
    }

    fn list_grid(&self) -> Result<Grid<'a>, Cause> {
        let expected = "an array or a list of numbers, or of rows of numbers";
        let items = self.list().ok_or_else(|| self.wrong(expected)).and_then(|_| self.items())?;
        let (mut numbers, mut columns) = (Vec::new(), 1);
        for (i, item) in items.iter().enumerate() {
            let row = match item.node() {
                Node::Int(_) | Node::Float(_) | Node::Bool(_) => vec![item.number()?],
                Node::Array(array) if array.dtype.is_number() => {
                    let row = item.array_grid(array, 0)?;
                    let length = row.rows.saturating_mul(row.columns);
                    item.spend(length)?;
                    (0..row.rows)
                        .flat_map(|r| (0..row.columns).map(move |c| (r, c)))
                        .map(|(r, c)| row.at(r, c))
                        .collect()
                }
                _ => item.items()?.iter().map(View::number).collect::<Result<Vec<f64>, _>>()?,
            };
            if i > 0 && row.len() != columns {
                return Err(item.wrong(format!("{columns} numbers as in the first row")));
            }
            columns = row.len();
            numbers.extend(row);
        }
        Ok(Grid { rows: items.len(), columns, numbers: Numbers::Listed(numbers) })
    }

    /// Returns points from rows of x, y and an optional z, which is not read.
    pub(crate) fn points(&self) -> Result<Vec<Vec2>, Cause> {
        let grid = self.grid()?;
        if grid.rows == 0 {
            return Ok(Vec::new());
        }
        if grid.columns < 2 {
            return Err(self.wrong("points of two or three coordinates"));
        }
        self.spend(grid.rows)?;
        (0..grid.rows)
            .map(|row| {
                let (x, y) = (grid.at(row, 0), grid.at(row, 1));
                if x.is_finite() && y.is_finite() {
                    return Ok(Vec2::new(x, y));
                }
                Err(Cause::value(format!("{}[{row}]", self.path), format!("({x}, {y})"), "a finite point"))
            })
            .collect()
    }

    /// Returns the height of each point, metres; none if the points have two coordinates.
    pub(crate) fn heights(&self) -> Result<Vec<f64>, Cause> {
        let grid = self.grid()?;
        if grid.columns < 3 {
            return Ok(Vec::new());
        }
        self.spend(grid.rows)?;
        Ok((0..grid.rows).map(|row| grid.at(row, 2)).collect())
    }

    /// Returns one point from two or three numbers.
    pub(crate) fn point(&self) -> Result<Vec2, Cause> {
        let grid = self.grid()?;
        let (x, y) = match (grid.rows, grid.columns) {
            (2 | 3, 1) => (grid.at(0, 0), grid.at(1, 0)),
            (1, 2 | 3) => (grid.at(0, 0), grid.at(0, 1)),
            _ => return Err(self.wrong("a point of two or three coordinates")),
        };
        if x.is_finite() && y.is_finite() {
            return Ok(Vec2::new(x, y));
        }
        Err(Cause::value(self.path.clone(), format!("({x}, {y})"), "a finite point"))
    }
}
