//! Fragments of views, and normals, that stay as they are from step to step.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use bokashi_core::Tensor;
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

/// What one renderer keeps: fragments by view, those of the first views that are drawn. Which of them are kept changes no
/// bit.
#[derive(Default)]
pub(super) struct FragmentCache {
    /// Normals at the vertices in the world.
    normals: OnceLock<Tensor<f32>>,
    views: Mutex<Views>,
}

#[derive(Default)]
struct Views {
    bytes: usize,
    /// What is visible, and the layers behind it.
    layers: HashMap<Key, Vec<ConstantFragments<f32>>>,
}

impl FragmentCache {
    pub(super) fn get(&self, key: Key) -> Option<Vec<ConstantFragments<f32>>> {
        self.lock().layers.get(&key).cloned()
    }

    pub(super) fn insert(&self, key: Key, layers: Vec<ConstantFragments<f32>>) {
        let bytes = layers.iter().map(ConstantFragments::coverage).map(|coverage| {
            PER_FRAGMENT * coverage.count()
                + PER_VERTEX * coverage.mesh().vertex_count()
                + PER_PIXEL * coverage.size().pixels()
        });
        let bytes = bytes.sum::<usize>();
        let mut views = self.lock();
        if views.bytes + bytes <= BUDGET && !views.layers.contains_key(&key) {
            views.bytes += bytes;
            views.layers.insert(key, layers);
        }
    }

    /// Where normals at the vertices are kept.
    pub(super) fn normals(&self) -> &OnceLock<Tensor<f32>> {
        &self.normals
    }

    fn lock(&self) -> MutexGuard<'_, Views> {
        self.views.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
