//! A tree of boxes around faces or points: which of them can meet a box, and which is the nearest.
//!
//! Items are halved at the median of their middles, along the axis on which these lie furthest apart. Equal middles
//! follow their indices, so the tree depends on nothing but the boxes.

use bokashi_render_ops::glam::DVec3;
use smallvec::SmallVec;

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

    /// Whether two boxes have a point in common.
    #[inline]
    pub(crate) fn meets(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }

    /// Whether no point lies within.
    fn is_empty(&self) -> bool {
        self.low.cmpgt(self.high).any()
    }

    fn has(&self, other: &Self) -> bool {
        self.low.cmple(other.low).all() && other.high.cmple(self.high).all()
    }

    /// The square of the distance to a point.
    #[inline]
    fn distance_squared(&self, point: DVec3) -> f64 {
        (self.low - point).max(point - self.high).max(DVec3::ZERO).length_squared()
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
    /// The first of two children, which are neighbours; of a leaf its place in the list of leaves.
    below: u32,
    is_leaf: bool,
}

/// The items of a leaf, side by side in memory.
type Leaf = SmallVec<[(Bounds, u32); PER_LEAF]>;

/// Items 0, 1, 2, ... by their boxes. These may change and items may be added: boxes of nodes only grow.
#[derive(Debug)]
pub(crate) struct BoxTree {
    nodes: Vec<Node>,
    leaves: Vec<Leaf>,
    /// Per item the node of its leaf; `NONE` where its box was empty when the tree was made.
    nodes_of: Vec<u32>,
}

impl BoxTree {
    /// Builds the tree. Items whose boxes are empty are left out for good.
    pub(crate) fn new(bounds: &[Bounds]) -> Self {
        let items = bounds.iter().copied().zip(0..);
        let mut items: Vec<(Bounds, u32)> = items.filter(|it| !it.0.is_empty()).collect();
        let root = Node { bounds: Bounds::NOTHING, parent: NONE, below: NONE, is_leaf: false };
        let mut tree =
            Self { nodes: vec![root], leaves: Vec::new(), nodes_of: vec![NONE; bounds.len()] };
        let mut open = vec![(0_usize, 0, items.len())];
        while let Some((node, start, end)) = open.pop() {
            let within = &mut items[start..end];
            let mut middles = Bounds::NOTHING;
            for (bounds, _) in &*within {
                tree.nodes[node].bounds = tree.nodes[node].bounds.with(bounds);
                let middle = bounds.middle();
                middles = middles.with(&Bounds { low: middle, high: middle });
            }
            if within.len() <= PER_LEAF {
                within.iter().for_each(|(_, item)| tree.nodes_of[*item as usize] = node as u32);
                (tree.nodes[node].below, tree.nodes[node].is_leaf) =
                    (tree.leaves.len() as u32, true);
                tree.leaves.push(Leaf::from_slice(within));
                continue;
            }
            let axis = (middles.high - middles.low).max_position();
            let half = within.len() / 2;
            within.select_nth_unstable_by(half, |one, other| {
                one.0.middle()[axis].total_cmp(&other.0.middle()[axis]).then(one.1.cmp(&other.1))
            });
            tree.nodes[node].below = tree.nodes.len() as u32;
            for (start, end) in [(start, start + half), (start + half, end)] {
                open.push((tree.nodes.len(), start, end));
                let (bounds, parent) = (Bounds::NOTHING, node as u32);
                tree.nodes.push(Node { bounds, parent, below: NONE, is_leaf: false });
            }
        }
        tree
    }

    fn leaf_of(&mut self, item: u32) -> &mut Leaf {
        let node = self.nodes_of[item as usize];
        &mut self.leaves[self.nodes[node as usize].below as usize]
    }

    /// Gives an item another box.
    pub(crate) fn change(&mut self, item: u32, bounds: Bounds) {
        if self.nodes_of[item as usize] == NONE {
            return;
        }
        let found = self.leaf_of(item).iter_mut().find(|it| it.1 == item);
        found.into_iter().for_each(|it| it.0 = bounds);
        let mut node = self.nodes_of[item as usize];
        while node != NONE {
            let Node { bounds: all, parent, .. } = &mut self.nodes[node as usize];
            if all.has(&bounds) {
                break;
            }
            *all = all.with(&bounds);
            node = *parent;
        }
    }

    /// Adds the next item to the leaf of `other`, which lies nearby and was not left out.
    pub(crate) fn add_beside(&mut self, other: u32, bounds: Bounds) {
        let item = self.nodes_of.len() as u32;
        self.nodes_of.push(self.nodes_of[other as usize]);
        self.leaf_of(item).push((bounds, item));
        self.change(item, bounds);
    }

    /// Calls `found` with each item whose box meets `bounds`, and with that box. The order follows from the calls that
    /// made and changed the tree.
    pub(crate) fn for_each_near(&self, bounds: &Bounds, mut found: impl FnMut(u32, &Bounds)) {
        self.has_near(bounds, |item, around| {
            found(item, around);
            false
        });
    }

    /// Whether `is_sought` is true of an item whose box meets `bounds`. The search ends with the first such item.
    pub(crate) fn has_near(
        &self,
        bounds: &Bounds,
        mut is_sought: impl FnMut(u32, &Bounds) -> bool,
    ) -> bool {
        let mut open = SmallVec::<[u32; 64]>::new();
        open.push(0);
        while let Some(index) = open.pop() {
            let node = &self.nodes[index as usize];
            if !node.bounds.meets(bounds) {
                continue;
            }
            if !node.is_leaf {
                open.extend([node.below + 1, node.below]);
                continue;
            }
            for (around, item) in &self.leaves[node.below as usize] {
                if around.meets(bounds) && is_sought(*item, around) {
                    return true;
                }
            }
        }
        false
    }

    /// The item with the least squared `distance` from `point`, and that distance; of equal ones the item with the
    /// lowest index. No item may be nearer than its box.
    pub(crate) fn nearest(&self, point: DVec3, distance: impl Fn(u32) -> f64) -> (u32, f64) {
        let (mut nearest, mut least) = (NONE, f64::INFINITY);
        let mut open = SmallVec::<[(u32, f64); 64]>::new();
        open.push((0, 0.0));
        while let Some((index, away)) = open.pop() {
            if away > least {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.is_leaf {
                for (bounds, item) in &self.leaves[node.below as usize] {
                    if bounds.distance_squared(point) > least {
                        continue;
                    }
                    let found = distance(*item);
                    if found < least || found == least && *item < nearest {
                        (nearest, least) = (*item, found);
                    }
                }
                continue;
            }
            let [first, second] = [node.below, node.below + 1]
                .map(|child| (child, self.nodes[child as usize].bounds.distance_squared(point)));
            // The nearer one is looked at first.
            open.extend(if first.1 <= second.1 { [second, first] } else { [first, second] });
        }
        (nearest, least)
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
        tree.for_each_near(bounds, |item, _| found.push(item));
        found.sort_unstable();
        found
    }

    #[test]
    fn what_meets_a_box_is_found_also_after_changes() {
        let mut boxes: Vec<_> = (0..200).map(cell).collect();
        let mut tree = BoxTree::new(&boxes);
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
    fn the_nearest_is_the_first_of_the_nearest_also_after_changes() {
        let mut boxes: Vec<_> = (0..200).map(cell).collect();
        let mut tree = BoxTree::new(&boxes);
        for changes in 0..2 {
            for k in 0..200 {
                // On corners of boxes, within some, beyond all.
                let point = cell(k * 11 + 3).low - 0.5 * DVec3::splat((k % 5) as f64);
                let away: Vec<_> = boxes.iter().map(|it| it.distance_squared(point)).collect();
                let least = away.iter().copied().fold(f64::INFINITY, f64::min);
                let first = away.iter().position(|it| *it == least).unwrap();
                let found = tree.nearest(point, |item| away[item as usize]);
                assert_eq!(found, (first as u32, least), "{k}, {changes}");
            }
            for k in 0..100 {
                boxes[k] = cell(k * 3 + 1);
                tree.change(k as u32, boxes[k]);
                boxes.push(cell(k * 2 + 5));
                tree.add_beside(k as u32, boxes[boxes.len() - 1]);
            }
        }
    }

    #[test]
    fn items_without_a_box_are_left_out_for_good() {
        let boxes: Vec<_> =
            (0..50).map(|k| if k % 3 == 0 { Bounds::around(&[]) } else { cell(k) }).collect();
        let mut tree = BoxTree::new(&boxes);
        tree.change(3, cell(3));
        let all = Bounds { low: DVec3::splat(-1.0), high: DVec3::splat(99.0) };
        assert_eq!(near(&tree, &all), (0..50).filter(|k| k % 3 != 0).collect::<Vec<_>>());
    }

    #[test]
    fn without_items_nothing_is_found() {
        assert!(near(&BoxTree::new(&[]), &cell(0)).is_empty());
        assert_eq!(BoxTree::new(&[]).nearest(DVec3::ZERO, |_| 0.0), (NONE, f64::INFINITY));
    }
}
