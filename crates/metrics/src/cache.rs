//! Values of different types, each computed once.

use std::any::Any;
use std::sync::OnceLock;

/// At most one value of each type. Values stay until the cache is dropped.
#[derive(Debug, Default)]
pub(super) struct Cache {
    first: OnceLock<Box<Node>>,
}

/// A value and its successor. The list is as long as the number of types, about ten.
#[derive(Debug)]
struct Node {
    value: Box<dyn Any + Send + Sync>,
    next: OnceLock<Box<Node>>,
}

impl Cache {
    /// Returns the value of this type; computes it at the first call. `compute` may use the cache for other
    /// types.
    pub(super) fn get_or_compute<T: Any + Send + Sync>(&self, compute: impl FnOnce() -> T) -> &T {
        let mut slot = &self.first;
        while let Some(node) = slot.get() {
            if let Some(value) = node.value.downcast_ref() {
                return value;
            }
            slot = &node.next;
        }
        let mut fresh = Some(Box::new(Node { value: Box::new(compute()), next: OnceLock::new() }));
        loop {
            // Another value may have taken the place in the meantime, even one of the same type.
            if let Some(node) = fresh.take()
                && let Err(rejected) = slot.set(node)
            {
                fresh = Some(rejected);
            }
            if let Some(node) = slot.get() {
                if let Some(value) = node.value.downcast_ref() {
                    return value;
                }
                slot = &node.next;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_has_one_value() {
        let cache = Cache::default();
        assert_eq!(*cache.get_or_compute(|| 1_u32), 1);
        assert_eq!(*cache.get_or_compute(|| 2_u32), 1);
        // A value that needs another one.
        let text: &String = cache.get_or_compute(|| format!("{}", cache.get_or_compute(|| 3_u64)));
        assert_eq!((text.as_str(), cache.get_or_compute(|| 4_u64)), ("3", &3));
    }

    #[test]
    fn threads_agree() {
        let cache = Cache::default();
        let seen: Vec<u32> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8)
                .map(|i| {
                    scope.spawn({
                        let cache = &cache;
                        move || *cache.get_or_compute(|| i)
                    })
                })
                .collect();
            threads.into_iter().map(|t| t.join().unwrap()).collect()
        });
        assert!(seen.windows(2).all(|w| w[0] == w[1]), "{seen:?}");
    }
}
