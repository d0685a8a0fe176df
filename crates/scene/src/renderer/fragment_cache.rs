//! Fragments of views that stay as they are from step to step.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use bokashi_render_ops::ConstantFragments;

/// The memory of fragments, in bytes.
const BUDGET: usize = 128 << 20;
/// Of a fragment: barycentrics, a weight, its face and pixel; at most, to the next power of two.
const PER_FRAGMENT: usize = 32;
/// Of a vertex in clip space.
const PER_VERTEX: usize = 16;
/// Of a pixel, seen or not.
const PER_PIXEL: usize = 8;

/// A view, how many times smaller it is, and how wide its margin is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Key {
    pub(super) view: usize,
    pub(super) reduce: usize,
    pub(super) margin: usize,
}

/// Fragments by view, those of the first views that are drawn. Which of them are kept changes no bit.
#[derive(Default)]
pub(super) struct FragmentCache(Mutex<Inner>);

#[derive(Default)]
struct Inner {
    bytes: usize,
    /// What is visible, and the layers behind it.
    views: HashMap<Key, Vec<ConstantFragments<f32>>>,
}

impl FragmentCache {
    pub(super) fn get(&self, key: Key) -> Option<Vec<ConstantFragments<f32>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).views.get(&key).cloned()
    }

    pub(super) fn insert(&self, key: Key, layers: Vec<ConstantFragments<f32>>) {
        let bytes = layers.iter().map(ConstantFragments::coverage).map(|coverage| {
            PER_FRAGMENT * coverage.count()
                + PER_VERTEX * coverage.mesh().vertex_count()
                + PER_PIXEL * coverage.size().pixels()
        });
        let bytes = bytes.sum::<usize>();
        let mut inner = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if inner.bytes + bytes <= BUDGET && !inner.views.contains_key(&key) {
            inner.bytes += bytes;
            inner.views.insert(key, layers);
        }
    }
}
