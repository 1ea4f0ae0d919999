//! A map that scenarios and rollouts share.

use std::fmt;
use std::ops::Deref;
use std::sync::{Arc, OnceLock};

use super::{MapIndex, Road, RoadMap};

/// A road map with its spatial index, which is built at the first use. Clones share both.
#[derive(Clone)]
pub struct SharedMap(Arc<(RoadMap, OnceLock<MapIndex>)>);

impl SharedMap {
    /// Shares a map.
    pub fn new(map: RoadMap) -> Self {
        Self(Arc::new((map, OnceLock::new())))
    }

    /// Returns the map with its index.
    pub fn road(&self) -> Road<'_> {
        Road::new(&self.0.0, self.0.1.get_or_init(|| MapIndex::new(&self.0.0)))
    }

    /// Returns the map for changes, which clones do not see.
    pub fn edit(&mut self) -> &mut RoadMap {
        if let Some((_, index)) = Arc::get_mut(&mut self.0) {
            index.take();
        } else {
            *self = Self::new(self.0.0.clone());
        }
        &mut Arc::get_mut(&mut self.0).expect("the map has one owner").0
    }
}

impl Deref for SharedMap {
    type Target = RoadMap;

    fn deref(&self) -> &RoadMap {
        &self.0.0
    }
}

impl PartialEq for SharedMap {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl fmt::Debug for SharedMap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}
