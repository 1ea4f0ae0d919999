//! The stack machine.

mod calls;

use std::ops::Range;

use super::globals::Global;
use super::{Id, Node};

/// Most values of a pickle: those of the largest scenarios are some hundred thousand.
const MOST_NODES: usize = 2_000_000;
/// Most values that wait on the stack: a list of so many items may be put together there.
const MOST_STACKED: usize = 1_000_000;
/// Most containers that are open at a time: those of a scenario are about ten.
const DEEPEST: usize = 200;
/// Longest name of a module or of what is in it.
const LONGEST_NAME: usize = 1000;
/// No value: an entry of the memo that nothing was put into.
const NOTHING: Id = Id::MAX;

/// Runs a pickle: its values, and which of them is the outermost.
pub(super) fn run(file: &[u8]) -> Result<(Vec<Node>, Id), String> {
    let mut machine = Machine {
        file,
        at: 0,
        nodes: Vec::new(),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: Vec::new(),
        memoized: 0,
        copied: 0,
        encoded: 0,
    };
    match file {
        [0x80, 2..=5, ..] => {}
        [0x80, protocol, ..] => return Err(format!("it has protocol {protocol}, expected 2 to 5")),
        _ => return Err("it does not begin as pickles of protocol 2 to 5 do; save it with protocol 4".into()),
    }
    loop {
        let at = machine.at;
        match machine.step() {
            Ok(None) => {}
            Ok(Some(root)) => return Ok((machine.nodes, root)),
            Err(what) => return Err(format!("at byte {at}: {what}")),
        }
    }
}

struct Machine<'a> {
    file: &'a [u8],
    at: usize,
    nodes: Vec<Node>,
    stack: Vec<Id>,
    /// Heights of the stack at which containers were opened.
    marks: Vec<usize>,
    memo: Vec<Id>,
    memoized: usize,
    copied: usize,
    encoded: usize,
}

impl<'a> Machine<'a> {
    /// One instruction; the outermost value after the last one.
    fn step(&mut self) -> Result<Option<Id>, String> {
        let opcode = self.take(1)?[0];
        match opcode {
            b'.' => {
                let root = self.pop()?;
                if !(self.stack.is_empty() && self.marks.is_empty()) {
                    return Err("it ends with values that belong to nothing".into());
                }
                return Ok(Some(root));
            }
            0x80 => {
                let protocol = self.take(1)?[0];
                if !(2..=5).contains(&protocol) {
                    return Err(format!("protocol {protocol}, expected 2 to 5"));
                }
            }
            0x95 => {
                let length = self.length(8)?;
                self.remains(length)?;
            }
            b'(' => {
                if self.marks.len() >= DEEPEST {
                    return Err(format!("more than {DEEPEST} containers lie in one another"));
                }
                self.marks.push(self.stack.len());
            }
            b'0' => {
                if self.marks.last() == Some(&self.stack.len()) {
                    self.marks.pop();
                } else {
                    self.pop()?;
                }
            }
            b'1' => {
                self.marked()?;
            }
            b'2' => {
                let top = self.top()?;
                self.push(top)?;
            }
            b'N' => self.make(Node::None)?,
            0x88 => self.make(Node::Bool(true))?,
            0x89 => self.make(Node::Bool(false))?,
            b'K' => {
                let v = self.length(1)? as i64;
                self.make(Node::Int(v))?;
            }
            b'M' => {
                let v = self.length(2)? as i64;
                self.make(Node::Int(v))?;
            }
            b'J' => {
                let bytes = self.take(4)?;
                self.make(Node::Int(integer(bytes)?))?;
            }
            0x8a | 0x8b => {
                let length = self.length(if opcode == 0x8a { 1 } else { 4 })?;
                let bytes = self.take(length)?;
                self.make(Node::Int(integer(bytes)?))?;
            }
            b'G' => {
                let bytes = self.take(8)?;
                let float = f64::from_be_bytes(bytes.try_into().map_err(|_| "no number".to_owned())?);
                self.make(Node::Float(float))?;
            }
            b'X' => self.text(4)?,
            0x8c => self.text(1)?,
            0x8d => self.text(8)?,
            b'U' | b'C' => self.bytes(1)?,
            b'T' | b'B' => self.bytes(4)?,
            0x8e | 0x96 => self.bytes(8)?,
            b']' | 0x8f => self.make(Node::List(Vec::new()))?,
            b'}' => self.make(Node::Dict(Vec::new()))?,
            b')' => self.make(Node::Tuple(Vec::new()))?,
            0x85..=0x87 => {
                let n = usize::from(opcode - 0x84);
                let mut items = Vec::with_capacity(n);
                for _ in 0..n {
                    items.push(self.pop()?);
                }
                items.reverse();
                self.make(Node::Tuple(items))?;
            }
            b't' => {
                let items = self.marked()?;
                self.make(Node::Tuple(items))?;
            }
            0x91 => {
                let items = self.marked()?;
                self.make(Node::List(items))?;
            }
            b'a' => {
                let item = self.pop()?;
                self.extend(vec![item])?;
            }
            b'e' | 0x90 => {
                let items = self.marked()?;
                self.extend(items)?;
            }
            b's' => {
                let value = self.pop()?;
                let key = self.pop()?;
                self.set(&[key, value])?;
            }
            b'u' => {
                let items = self.marked()?;
                self.set(&items)?;
            }
            b'q' => {
                let index = self.length(1)?;
                self.put(index)?;
            }
            b'r' => {
                let index = self.length(4)?;
                self.put(index)?;
            }
            0x94 => self.put(self.memoized)?,
            b'h' => {
                let index = self.length(1)?;
                self.get(index)?;
            }
            b'j' => {
                let index = self.length(4)?;
                self.get(index)?;
            }
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                let global = Global::find(&module, &name)?;
                self.make(Node::Global(global))?;
            }
            0x93 => {
                let (name, module) = (self.pop()?, self.pop()?);
                let global = Global::find(self.name(module)?, self.name(name)?)?;
                self.make(Node::Global(global))?;
            }
            b'R' => {
                let (arguments, callee) = (self.pop()?, self.pop()?);
                let made = self.call(callee, arguments)?;
                self.make(made)?;
            }
            0x81 => {
                let (_, class) = (self.pop()?, self.pop()?);
                match self.node(class) {
                    Node::Global(Global::Dict) => self.make(Node::Dict(Vec::new()))?,
                    _ => return Err("it makes an object of a class that can not be made so".into()),
                }
            }
            b'b' => {
                let state = self.pop()?;
                let object = self.top()?;
                self.build(object, state)?;
            }
            b'i' => {
                // Old classes; the name is said where it is none of those that are known.
                let (module, name) = (self.line()?, self.line()?);
                Global::find(&module, &name)?;
                return Err("it makes an object of an old class; save it with protocol 4".into());
            }
            b'P' | b'Q' => return Err("it refers to values outside the file; save it whole".into()),
            0x97 | 0x98 => return Err("its arrays lie outside the file; save it whole".into()),
            0x82..=0x84 => return Err("it names things by a registry that only Python has".into()),
            _ => {
                return Err(format!(
                    "the opcode {opcode:#04x} is not one of those of plain data; save it with protocol 4"
                ));
            }
        }
        Ok(None)
    }

    fn remains(&self, length: usize) -> Result<(), String> {
        let left = self.file.len() - self.at;
        if length > left {
            return Err(format!(
                "{length} bytes should follow and {left} do: the file is cut; fetch it again"
            ));
        }
        Ok(())
    }

    fn take(&mut self, length: usize) -> Result<&'a [u8], String> {
        self.remains(length)?;
        let taken = &self.file[self.at..self.at + length];
        self.at += length;
        Ok(taken)
    }

    /// An unsigned number of so many bytes.
    fn length(&mut self, bytes: usize) -> Result<usize, String> {
        let mut all = [0_u8; 8];
        all[..bytes].copy_from_slice(self.take(bytes)?);
        usize::try_from(u64::from_le_bytes(all)).map_err(|_| "a length beyond all memory".into())
    }

    /// The place of what follows its length.
    fn range(&mut self, bytes: usize) -> Result<Range<u32>, String> {
        let length = self.length(bytes)?;
        let start = self.at;
        self.take(length)?;
        let place = |v: usize| u32::try_from(v).map_err(|_| "the file is too long".to_owned());
        Ok(place(start)?..place(self.at)?)
    }

    fn text(&mut self, bytes: usize) -> Result<(), String> {
        let range = self.range(bytes)?;
        let text = &self.file[range.start as usize..range.end as usize];
        std::str::from_utf8(text).map_err(|_| "a text is no UTF-8")?;
        self.make(Node::Text(range))
    }

    fn bytes(&mut self, bytes: usize) -> Result<(), String> {
        let range = self.range(bytes)?;
        self.make(Node::Bytes(range))
    }

    fn line(&mut self) -> Result<String, String> {
        let rest = &self.file[self.at..];
        let end = rest.iter().take(LONGEST_NAME).position(|b| *b == b'\n');
        let end = end.ok_or("a name has no end")?;
        let line = self.take(end + 1)?;
        Ok(String::from_utf8_lossy(&line[..end]).into_owned())
    }

    fn push(&mut self, id: Id) -> Result<(), String> {
        if self.stack.len() >= MOST_STACKED {
            return Err(format!("more than {MOST_STACKED} values wait on the stack"));
        }
        self.stack.push(id);
        Ok(())
    }

    fn make(&mut self, node: Node) -> Result<(), String> {
        if self.nodes.len() >= MOST_NODES {
            return Err(format!("it holds more than {MOST_NODES} values, expected one scenario"));
        }
        let id = self.nodes.len() as Id;
        self.nodes.push(node);
        self.push(id)
    }

    /// The uppermost value; those of outer containers are out of reach.
    fn top(&self) -> Result<Id, String> {
        let floor = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() <= floor {
            return Err("a value is missing on the stack".into());
        }
        self.stack.last().copied().ok_or_else(|| "the stack is empty".into())
    }

    fn pop(&mut self) -> Result<Id, String> {
        let top = self.top()?;
        self.stack.pop();
        Ok(top)
    }

    /// All values since the last mark, which is taken away.
    fn marked(&mut self) -> Result<Vec<Id>, String> {
        let mark = self.marks.pop().ok_or("a mark is missing on the stack")?;
        Ok(self.stack.split_off(mark))
    }

    fn put(&mut self, index: usize) -> Result<(), String> {
        let top = self.top()?;
        if index >= MOST_NODES {
            return Err(format!("the memo has an entry {index}, expected at most {MOST_NODES}"));
        }
        if index >= self.memo.len() {
            self.memo.resize(index + 1, NOTHING);
        }
        if self.memo[index] == NOTHING {
            self.memoized += 1;
        }
        self.memo[index] = top;
        Ok(())
    }

    fn get(&mut self, index: usize) -> Result<(), String> {
        let found = self.memo.get(index).copied().filter(|id| *id != NOTHING);
        self.push(found.ok_or_else(|| format!("the memo has no entry {index}"))?)
    }

    fn node(&self, id: Id) -> &Node {
        &self.nodes[id as usize]
    }

    fn extend(&mut self, items: Vec<Id>) -> Result<(), String> {
        let list = self.top()?;
        match &mut self.nodes[list as usize] {
            Node::List(all) => all.extend(items),
            _ => return Err("items are added to what is no list".into()),
        }
        Ok(())
    }

    fn set(&mut self, items: &[Id]) -> Result<(), String> {
        let dict = self.top()?;
        if !items.len().is_multiple_of(2) {
            return Err("a key without a value".into());
        }
        match &mut self.nodes[dict as usize] {
            Node::Dict(all) => all.extend(items.chunks_exact(2).map(|pair| (pair[0], pair[1]))),
            _ => return Err("keys are set in what is no dictionary".into()),
        }
        Ok(())
    }

    /// A text, also where it is spelled as bytes.
    fn name(&self, id: Id) -> Result<&'a str, String> {
        match self.node(id) {
            Node::Text(r) | Node::Bytes(r) => {
                let text = &self.file[r.start as usize..r.end as usize];
                std::str::from_utf8(text).map_err(|_| "a name is no UTF-8".into())
            }
            _ => Err("a name is no text".into()),
        }
    }

    fn tuple(&self, id: Id) -> Result<&[Id], String> {
        match self.node(id) {
            Node::Tuple(items) => Ok(items),
            _ => Err("arguments are no tuple".into()),
        }
    }
}

/// A signed number, little end first.
fn integer(bytes: &[u8]) -> Result<i64, String> {
    if bytes.len() > 8 {
        return Err("a whole number of more than 64 bits".into());
    }
    let negative = bytes.last().is_some_and(|b| b & 0x80 != 0);
    let mut all = [if negative { 0xff } else { 0 }; 8];
    all[..bytes.len()].copy_from_slice(bytes);
    Ok(i64::from_le_bytes(all))
}
