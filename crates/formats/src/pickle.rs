//! Python pickles of plain containers, numpy arrays and, if wanted, objects and tensors, read without running
//! anything.
//!
//! A pickle is a program for a small stack machine, two instructions of which call functions that the file
//! refers to by name. Here names are looked up in a short list with fixed meanings ([`globals::Global`]); any
//! other name is an error, or, in files of objects ([`Pickle::read_objects`]), the name of a class, whose
//! objects are dictionaries of their attributes. Texts and arrays are not copied: they are ranges of the
//! file. Opcodes: Python's `Lib/pickletools.py`; protocols 2 to 5.

mod archive;
mod array;
mod globals;
mod machine;
mod view;

#[cfg(test)]
mod tests;

use std::cell::Cell;
use std::collections::BTreeMap;
use std::ops::Range;

pub(crate) use self::array::Grid;
use self::array::{Array, Dtype};
use self::globals::Global;
pub(crate) use self::view::View;

/// Index of a value in a pickle.
type Id = u32;

/// A value. Containers refer to their content by index, so that deep nesting and cycles are harmless.
#[derive(Debug)]
enum Node {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    /// UTF-8 text as a byte range of the file.
    Text(Range<u32>),
    /// Bytes as a byte range of the file.
    Bytes(Range<u32>),
    /// Bytes that are encoded in the file.
    OwnedBytes(Vec<u8>),
    /// A list or a set.
    List(Vec<Id>),
    Tuple(Vec<Id>),
    /// Pairs in file order; of equal keys the last one applies.
    Dict(Vec<(Id, Id)>),
    Global(Global),
    /// Name of a class, or of a function that is not called.
    Class(String),
    Dtype(Dtype),
    Array(Box<Array>),
}

/// Names that a pickle may refer to.
enum Names {
    /// Those with a meaning here.
    Listed,
    /// Any, and storages of tensors by these keys.
    Any(BTreeMap<String, Range<u32>>),
    /// Those of the description of a storage, whose numbers follow it.
    Storage,
}

pub(crate) struct Pickle<'a> {
    file: &'a [u8],
    nodes: Vec<Node>,
    root: Id,
    /// Remaining number of points, numbers and items that may be extracted. Without a limit, values with many
    /// references could expand without bound.
    budget: Cell<usize>,
}

/// Maximum number of points, numbers and items that are extracted from one pickle.
const EXTRACTION_BUDGET: usize = 4_000_000;

impl<'a> Pickle<'a> {
    /// Reads a pickle; errors name the byte offset.
    pub(crate) fn read(file: &'a [u8]) -> Result<Self, String> {
        Self::run(file, 0..file.len(), Names::Listed)
    }

    /// Reads a pickle, also in an archive of PyTorch, that may contain objects of any class and tensors.
    pub(crate) fn read_objects(file: &'a [u8]) -> Result<Self, String> {
        if !archive::is_archive(file) {
            return Self::run(file, 0..file.len(), Names::Any(BTreeMap::new()));
        }
        let (pickle, storages) = archive::parts(file)?;
        Self::run(file, pickle, Names::Any(storages))
    }

    fn run(file: &'a [u8], part: Range<usize>, names: Names) -> Result<Self, String> {
        let (nodes, root, _) = machine::run(file, part, names)?;
        Ok(Self { file, nodes, root, budget: Cell::new(EXTRACTION_BUDGET) })
    }

    pub(crate) fn root(&self) -> View<'_> {
        View::new(self, self.root, String::new())
    }

    fn node(&self, id: Id) -> &Node {
        &self.nodes[id as usize]
    }

    fn bytes(&self, range: &Range<u32>) -> &'a [u8] {
        &self.file[range.start as usize..range.end as usize]
    }
}
