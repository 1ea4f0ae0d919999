//! Neighbour lists of attention: edges as rows of equal length.

use burn::tensor::{Device, IndexingUpdateOp, Int, Tensor, TensorData};

/// Up to K sources for each of N destinations; the remaining slots of a row are closed. A list of
/// edges is converted to this form so that attention consists of gathers and dense products.
#[derive(Clone, Debug)]
pub struct Neighbors {
    destinations: usize,
    slots: usize,
    /// Whether the row length was given by the caller, not derived from edges.
    fixed: bool,
    /// Row of the source of each slot, [N·K]; 0 for closed slots.
    source: Tensor<1, Int>,
    /// Row of each slot in a table of all pairs of sources and destinations, [N·K]: source · N +
    /// destination.
    pair: Tensor<1, Int>,
    /// Row of the edge of each slot in the list of edges, [N·K]; 0 for closed slots.
    edge: Tensor<1, Int>,
    /// Offset added to scores, [N, 1, K]: 0 for open slots, very negative for closed ones.
    closed: Tensor<3>,
    /// 1 if a destination has a source, else 0; [N, 1].
    any: Tensor<2>,
}

/// Offset added to the score of a closed slot, large enough that the exponential is exactly 0 in
/// f32.
const CLOSED_SCORE: f32 = -1e9;

impl Neighbors {
    /// Builds rows from edges (source, destination) in any order; the slots of a destination follow
    /// the order of its edges.
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
        let mut closed = vec![CLOSED_SCORE; destinations * slots];
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

    /// Builds rows from row-major lists [N, K] of sources and of flags for open slots. Slots are
    /// edges: the relation of slot k of destination n is row n·K + k.
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
        let closed = open.iter().map(|&o| if o { 0.0 } else { CLOSED_SCORE }).collect::<Vec<_>>();
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

    /// Returns N, the number of destinations.
    pub fn destinations(&self) -> usize {
        self.destinations
    }

    /// Returns whether the row length was given by the caller.
    pub(super) fn is_fixed(&self) -> bool {
        self.fixed
    }

    /// Returns K, the row length.
    pub fn slots(&self) -> usize {
        self.slots
    }

    /// Gathers the edge vectors of all slots: [E, d] to [N, K, d]. Closed slots get the vector of
    /// the first edge, which has no effect.
    pub fn relations(&self, edges: Tensor<2>) -> Tensor<3> {
        self.gather(edges, &self.edge)
    }

    /// Gathers the source features of all slots: [M, h] to [N, K, h].
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

    /// Gathers the rows of all slots from a table of all pairs of sources and destinations: [M·N,
    /// w] to [N, K, w].
    pub(super) fn pairs(&self, table: Tensor<2>) -> Tensor<3> {
        self.gather(table, &self.pair)
    }

    /// Scatters [N, K, w] into a table of `sources` · N rows that is 0 elsewhere; the inverse of
    /// [`Self::pairs`]. Values of closed slots are added to the pair of their destination and the
    /// first source.
    pub(super) fn spread(&self, slots: Tensor<3>, sources: usize) -> Tensor<2> {
        let width = slots.dims()[2];
        let table = Tensor::zeros([sources * self.destinations, width], &slots.device());
        let rows = slots.reshape([self.destinations * self.slots, width]);
        table.select_assign(0, self.pair.clone(), rows, IndexingUpdateOp::Add)
    }

    /// Returns the offsets of scores, [N, 1, K].
    pub(super) fn closed(&self) -> Tensor<3> {
        self.closed.clone()
    }

    /// Returns 1 for destinations with a source, else 0; [N, 1].
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
