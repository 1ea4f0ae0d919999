//! Python pickles of plain containers and numpy arrays, read without running anything.
//!
//! A pickle is a program for a small stack machine, of which two instructions call what the file names. Here such a name is looked up in
//! a short list ([`globals::Global`]) and means what this program makes of it; any other name ends the reading. Text and arrays are not copied:
//! they are ranges of the file. Opcodes: Python's `Lib/pickletools.py`; protocols 2 to 5.

mod array;
mod globals;
mod machine;
mod view;

#[cfg(test)]
mod tests;

use std::cell::Cell;
use std::ops::Range;

pub(super) use self::array::Grid;
use self::array::{Array, Dtype};
use self::globals::Global;
pub(super) use self::view::View;

/// Index of a value among those of a pickle.
type Id = u32;

/// A value. Containers name their content by index, so that neither depth nor loops matter.
#[derive(Debug)]
enum Node {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    /// UTF-8, by its place in the file.
    Text(Range<u32>),
    /// Bytes by their place in the file.
    Bytes(Range<u32>),
    /// Bytes that the file spells otherwise.
    Own(Vec<u8>),
    /// A list or a set.
    List(Vec<Id>),
    Tuple(Vec<Id>),
    /// Pairs in the order of the file; of equal keys the last one holds.
    Dict(Vec<(Id, Id)>),
    Global(Global),
    Dtype(Dtype),
    Array(Box<Array>),
}

/// What a pickle holds.
pub(super) struct Pickle<'a> {
    file: &'a [u8],
    nodes: Vec<Node>,
    root: Id,
    /// Points, numbers and items that may still be taken out: values that are named often could be without end otherwise.
    budget: Cell<usize>,
}

/// Most points, numbers and items that are taken out of one pickle.
const MOST_TAKEN: usize = 4_000_000;

impl<'a> Pickle<'a> {
    /// Reads a pickle; what is wrong is said with the byte where it stands.
    pub(super) fn read(file: &'a [u8]) -> Result<Self, String> {
        let (nodes, root) = machine::run(file)?;
        Ok(Self { file, nodes, root, budget: Cell::new(MOST_TAKEN) })
    }

    /// The outermost value.
    pub(super) fn root(&self) -> View<'_> {
        View::new(self, self.root, String::new())
    }

    fn node(&self, id: Id) -> &Node {
        &self.nodes[id as usize]
    }

    fn bytes(&self, range: &Range<u32>) -> &'a [u8] {
        &self.file[range.start as usize..range.end as usize]
    }
}
