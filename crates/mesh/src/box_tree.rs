//! A tree of boxes around faces: which of them can meet a box.

use bokashi_render_ops::glam::DVec3;

/// A box whose sides are parallel to the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bounds {
    low: DVec3,
    high: DVec3,
}

impl Bounds {
    const NOTHING: Self = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    pub(crate) fn around(points: &[DVec3]) -> Self {
        points.iter().fold(Self::NOTHING, |it, &point| Self {
            low: it.low.min(point),
            high: it.high.max(point),
        })
    }

    pub(crate) fn with(&self, other: &Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Whether both have a point in common.
    #[inline]
    pub(crate) fn meets(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }

    fn has(&self, other: &Self) -> bool {
        self.low.cmple(other.low).all() && other.high.cmple(self.high).all()
    }

    fn middle(&self) -> DVec3 {
        0.5 * (self.low + self.high)
    }
}

/// Stands for no node and no item.
const NONE: u32 = u32::MAX;

/// Items in a leaf: fewer make the tree deeper, more are tested in vain.
const PER_LEAF: usize = 4;

#[derive(Debug)]
struct Node {
    bounds: Bounds,
    parent: u32,
    /// The first of two children, which are neighbours; [`NONE`] for a leaf.
    children: u32,
    /// The first item of a leaf.
    first: u32,
}

/// Items 0, 1, 2, ... by their boxes. These may change and items may be added: boxes of nodes only grow.
#[derive(Debug)]
pub(crate) struct BoxTree {
    nodes: Vec<Node>,
    bounds: Vec<Bounds>,
    /// Per item: its leaf, and the next item of the leaf.
    leaves: Vec<u32>,
    next: Vec<u32>,
}

impl BoxTree {
    pub(crate) fn new(bounds: Vec<Bounds>) -> Self {
        let mut items: Vec<u32> = (0..bounds.len() as u32).collect();
        let (leaves, next) = (vec![NONE; bounds.len()], vec![NONE; bounds.len()]);
        let mut tree = Self { nodes: Vec::new(), bounds, leaves, next };
        tree.nodes.push(Node {
            bounds: Bounds::NOTHING,
            parent: NONE,
            children: NONE,
            first: NONE,
        });
        let mut open = vec![(0_u32, 0, items.len())];
        while let Some((node, start, end)) = open.pop() {
            let within = &mut items[start..end];
            let union = |all: Bounds, item: &u32| all.with(&tree.bounds[*item as usize]);
            tree.nodes[node as usize].bounds = within.iter().fold(Bounds::NOTHING, union);
            if within.len() <= PER_LEAF {
                within.iter().rev().for_each(|item| tree.put(*item, node));
                continue;
            }
            let middle = |item: &u32| tree.bounds[*item as usize].middle();
            let points: Bounds = within.iter().fold(Bounds::NOTHING, |all, item| {
                let point = middle(item);
                all.with(&Bounds { low: point, high: point })
            });
            let axis = (points.high - points.low).max_position();
            let half = within.len() / 2;
            within.select_nth_unstable_by(half, |left, right| {
                middle(left)[axis].total_cmp(&middle(right)[axis]).then(left.cmp(right))
            });
            let children = tree.nodes.len() as u32;
            tree.nodes[node as usize].children = children;
            for range in [(start, start + half), (start + half, end)] {
                open.push((tree.nodes.len() as u32, range.0, range.1));
                let bounds = Bounds::NOTHING;
                tree.nodes.push(Node { bounds, parent: node, children: NONE, first: NONE });
            }
        }
        tree
    }

    fn put(&mut self, item: u32, leaf: u32) {
        self.leaves[item as usize] = leaf;
        self.next[item as usize] = self.nodes[leaf as usize].first;
        self.nodes[leaf as usize].first = item;
    }

    /// Gives an item another box.
    pub(crate) fn change(&mut self, item: u32, bounds: Bounds) {
        self.bounds[item as usize] = bounds;
        let mut node = self.leaves[item as usize];
        while node != NONE {
            let Node { bounds: all, parent, .. } = &mut self.nodes[node as usize];
            if all.has(&bounds) {
                break;
            }
            *all = all.with(&bounds);
            node = *parent;
        }
    }

    /// Adds the next item to the leaf of `other`, which lies nearby.
    pub(crate) fn add_beside(&mut self, other: u32, bounds: Bounds) {
        let item = self.bounds.len() as u32;
        self.bounds.push(bounds);
        self.leaves.push(NONE);
        self.next.push(NONE);
        self.put(item, self.leaves[other as usize]);
        self.change(item, bounds);
    }

    /// Calls `found` with each item whose box meets `bounds`, in an order that depends on what was done alone.
    pub(crate) fn for_each_near(&self, bounds: &Bounds, mut found: impl FnMut(u32)) {
        let mut open = smallvec::SmallVec::<[u32; 64]>::new();
        open.push(0);
        while let Some(index) = open.pop() {
            let node = &self.nodes[index as usize];
            if !node.bounds.meets(bounds) {
                continue;
            }
            if node.children != NONE {
                open.extend([node.children + 1, node.children]);
                continue;
            }
            let mut item = node.first;
            while item != NONE {
                if self.bounds[item as usize].meets(bounds) {
                    found(item);
                }
                item = self.next[item as usize];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(k: usize) -> Bounds {
        let low = DVec3::new((k * 7 % 13) as f64, (k * 5 % 11) as f64, (k % 3) as f64);
        Bounds { low, high: low + 1.5 }
    }

    fn near(tree: &BoxTree, bounds: &Bounds) -> Vec<u32> {
        let mut found = Vec::new();
        tree.for_each_near(bounds, |item| found.push(item));
        found.sort_unstable();
        found
    }

    #[test]
    fn what_meets_a_box_is_found_also_after_changes() {
        let mut boxes: Vec<_> = (0..200).map(cell).collect();
        let mut tree = BoxTree::new(boxes.clone());
        for k in 0..100 {
            let changed = cell(k * 3 + 1);
            boxes[k] = changed;
            tree.change(k as u32, changed);
            boxes.push(cell(k * 2 + 5));
            tree.add_beside(k as u32, boxes[boxes.len() - 1]);
        }
        for k in 0..60 {
            let asked = Bounds { high: cell(k).low + 0.5, ..cell(k) };
            let all = (0..boxes.len()).filter(|i| boxes[*i].meets(&asked)).map(|i| i as u32);
            assert_eq!(near(&tree, &asked), all.collect::<Vec<_>>());
        }
    }

    #[test]
    fn without_items_nothing_is_found() {
        assert!(near(&BoxTree::new(Vec::new()), &cell(0)).is_empty());
    }
}
