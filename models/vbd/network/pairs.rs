//! Which elements of a scene each element sees.

/// For each of the first elements of a scene those that it sees.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Pairs {
    /// Number of elements that see.
    pub(super) own: usize,
    /// Number of elements that each of them sees.
    pub(super) each: usize,
    /// Those elements, `[own, each]`; `None` if they are the first ones for all.
    pub(super) others: Option<Vec<u32>>,
}

impl Pairs {
    /// Lets each of the first `own` elements see the nearest of the first `among`, at most `limit`, itself
    /// included. Elements that are not there count as farthest.
    pub(super) fn nearest(
        positions: &[[f64; 2]],
        present: &[bool],
        own: usize,
        among: usize,
        limit: usize,
    ) -> Self {
        if among <= limit {
            return Self { own, each: among, others: None };
        }
        let mut others = Vec::with_capacity(own * limit);
        for from in &positions[..own] {
            let mut found: Vec<(bool, f64, u32)> = (0..among as u32)
                .zip(positions.iter().zip(present))
                .map(|(i, (at, present))| {
                    let [dx, dy] = [at[0] - from[0], at[1] - from[1]];
                    (!present, dx * dx + dy * dy, i)
                })
                .collect();
            found.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
            others.extend(found[..limit].iter().map(|(_, _, i)| i));
        }
        Self { own, each: limit, others: Some(others) }
    }

    /// Returns the elements that an element sees.
    pub(super) fn of(&self, own: usize) -> impl Iterator<Item = usize> {
        let listed = self.others.as_ref().map(|others| &others[own * self.each..]);
        (0..self.each).map(move |k| listed.map_or(k, |others| others[k] as usize))
    }
}

#[cfg(test)]
mod tests {
    use super::Pairs;

    const PLACES: [[f64; 2]; 4] = [[0.0, 0.0], [3.0, 0.0], [1.0, 0.0], [0.5, 0.0]];

    #[test]
    fn elements_see_themselves_and_the_nearest() {
        let pairs = Pairs::nearest(&PLACES, &[true; 4], 2, 4, 2);
        assert_eq!(pairs.of(0).collect::<Vec<_>>(), [0, 3]);
        assert_eq!(pairs.of(1).collect::<Vec<_>>(), [1, 2]);
        let among_three = Pairs::nearest(&PLACES, &[true; 4], 1, 3, 2);
        assert_eq!(among_three.of(0).collect::<Vec<_>>(), [0, 2]);
    }

    #[test]
    fn absent_elements_come_last_and_no_more_than_there_are_are_seen() {
        let pairs = Pairs::nearest(&PLACES, &[true, true, true, false], 1, 4, 2);
        assert_eq!(pairs.of(0).collect::<Vec<_>>(), [0, 2]);
        let all = Pairs::nearest(&PLACES, &[true; 4], 3, 4, 9);
        assert_eq!((all.others.as_ref(), all.of(2).collect()), (None, vec![0, 1, 2, 3]));
    }
}
