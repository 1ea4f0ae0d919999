//! Who attends to whom: lists of edges as rows of equal length.

use burn::tensor::{Device, IndexingUpdateOp, Int, Tensor, TensorData};

/// For every one of N destinations up to K sources, the rest of the row closed. It is what a list of edges becomes so that attention is
/// made of gathers and dense products.
#[derive(Clone, Debug)]
pub struct Neighbors {
    destinations: usize,
    slots: usize,
    /// Whether the length of rows was given, not found.
    fixed: bool,
    /// Row of the source of each slot, [N·K]; closed slots hold 0.
    source: Tensor<1, Int>,
    /// Row of each slot in a table of all sources with all destinations, [N·K]: source · N + destination.
    pair: Tensor<1, Int>,
    /// Row of the edge of each slot in the list of edges, [N·K]; closed slots hold 0.
    edge: Tensor<1, Int>,
    /// Added to scores, [N, 1, K]: 0 where open, very negative where closed.
    closed: Tensor<3>,
    /// [N, 1]: 1 where a destination has a source, else 0.
    any: Tensor<2>,
}

/// Added to the score of a closed slot: the exponential of what is left of it is exactly 0 in f32.
const CLOSED: f32 = -1e9;

impl Neighbors {
    /// From edges (source, destination) in any order; slots of a destination are in the order of its edges.
    ///
    /// # Panics
    /// If a destination is not below `destinations`, or the two lists differ in length.
    pub fn from_edges(destinations: usize, sources: &[u32], targets: &[u32], device: &Device) -> Self {
        assert_eq!(sources.len(), targets.len(), "edges have two ends");
        let mut degree = vec![0usize; destinations];
        for &target in targets {
            degree[target as usize] += 1;
        }
        let slots = degree.iter().copied().max().unwrap_or(0);
        let mut source = vec![0i32; destinations * slots];
        let mut edge = vec![0i32; destinations * slots];
        let mut closed = vec![CLOSED; destinations * slots];
        let mut filled = vec![0usize; destinations];
        for (row, (&from, &to)) in sources.iter().zip(targets).enumerate() {
            let to = to as usize;
            let slot = to * slots + filled[to];
            filled[to] += 1;
            source[slot] = from as i32;
            edge[slot] = row as i32;
            closed[slot] = 0.0;
        }
        let any = degree.iter().map(|&d| if d > 0 { 1.0f32 } else { 0.0 }).collect::<Vec<_>>();
        Self {
            destinations,
            slots,
            fixed: false,
            pair: pairs(&source, destinations, slots, device),
            source: ints(source, device),
            edge: ints(edge, device),
            closed: Tensor::from_data(TensorData::new(closed, [destinations, 1, slots]), device),
            any: Tensor::from_data(TensorData::new(any, [destinations, 1]), device),
        }
    }

    /// From rows of equal length: sources [N, K] and which of them count (1 or 0) [N, K], row by row. Slots are edges: the relation of
    /// slot k of destination n is row n·K + k.
    ///
    /// # Panics
    /// If the lengths are not N·K.
    pub fn from_slots(
        destinations: usize,
        slots: usize,
        sources: &[u32],
        open: &[bool],
        device: &Device,
    ) -> Self {
        assert_eq!(
            (sources.len(), open.len()),
            (destinations * slots, destinations * slots),
            "rows of slots"
        );
        let any = (0..destinations)
            .map(|n| if open[n * slots..(n + 1) * slots].contains(&true) { 1.0f32 } else { 0.0 })
            .collect::<Vec<_>>();
        let closed = open.iter().map(|&o| if o { 0.0 } else { CLOSED }).collect::<Vec<_>>();
        let source: Vec<i32> =
            sources.iter().zip(open).map(|(&s, &o)| if o { s as i32 } else { 0 }).collect();
        Self {
            destinations,
            slots,
            fixed: true,
            pair: pairs(&source, destinations, slots, device),
            source: ints(source, device),
            edge: ints((0..(destinations * slots) as i32).collect(), device),
            closed: Tensor::from_data(TensorData::new(closed, [destinations, 1, slots]), device),
            any: Tensor::from_data(TensorData::new(any, [destinations, 1]), device),
        }
    }

    /// N: how many destinations there are.
    pub fn destinations(&self) -> usize {
        self.destinations
    }

    /// Whether rows are of a length that was given.
    pub(super) fn is_fixed(&self) -> bool {
        self.fixed
    }

    /// K: the length of a row.
    pub fn slots(&self) -> usize {
        self.slots
    }

    /// What each slot's edge has: [E, d] to [N, K, d]. Closed slots get the first edge's, which counts for nothing.
    pub fn relations(&self, edges: Tensor<2>) -> Tensor<3> {
        self.gather(edges, &self.edge)
    }

    /// What each slot's source has: [M, h] to [N, K, h].
    pub fn sources(&self, nodes: Tensor<2>) -> Tensor<3> {
        self.gather(nodes, &self.source)
    }

    fn gather(&self, rows: Tensor<2>, index: &Tensor<1, Int>) -> Tensor<3> {
        let [count, width] = rows.dims();
        if self.slots == 0 || count == 0 {
            return Tensor::zeros([self.destinations, self.slots, width], &rows.device());
        }
        rows.select(0, index.clone()).reshape([self.destinations, self.slots, width])
    }

    /// What each slot has in a table of all sources with all destinations: [M·N, w] to [N, K, w].
    pub(super) fn pairs(&self, table: Tensor<2>) -> Tensor<3> {
        self.gather(table, &self.pair)
    }

    /// The other way round: [N, K, w] to a table of `sources` · N rows that is 0 elsewhere. What closed slots hold is added to their
    /// destination's pair with the first source.
    pub(super) fn spread(&self, slots: Tensor<3>, sources: usize) -> Tensor<2> {
        let width = slots.dims()[2];
        let table = Tensor::zeros([sources * self.destinations, width], &slots.device());
        let rows = slots.reshape([self.destinations * self.slots, width]);
        table.select_assign(0, self.pair.clone(), rows, IndexingUpdateOp::Add)
    }

    /// [N, 1, K]: to be added to scores.
    pub(super) fn closed(&self) -> Tensor<3> {
        self.closed.clone()
    }

    /// [N, 1]: 1 where there is a source.
    pub(super) fn any(&self) -> Tensor<2> {
        self.any.clone()
    }
}

fn pairs(source: &[i32], destinations: usize, slots: usize, device: &Device) -> Tensor<1, Int> {
    let pair = |(slot, source): (usize, &i32)| source * destinations as i32 + (slot / slots) as i32;
    ints(source.iter().enumerate().map(pair).collect(), device)
}

fn ints(values: Vec<i32>, device: &Device) -> Tensor<1, Int> {
    let length = values.len();
    Tensor::from_data(TensorData::new(values, [length]), device)
}
