//! Numbers that are joined to groups, one pair at a time.

/// Stands for no group.
pub(crate) const NO_GROUP: u32 = u32::MAX;

/// Groups of numbers: by number, one that is not higher in its group, up to the lowest, which stands for itself.
#[derive(Debug)]
pub(crate) struct Groups(Vec<u32>);

impl Groups {
    /// So many numbers, each a group of its own.
    pub(crate) fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// The lowest number of a group.
    pub(crate) fn first(&mut self, mut number: u32) -> u32 {
        while self.0[number as usize] != number {
            // Paths are halved as they are walked.
            self.0[number as usize] = self.0[self.0[number as usize] as usize];
            number = self.0[number as usize];
        }
        number
    }

    /// Joins the groups of two numbers.
    pub(crate) fn join(&mut self, one: u32, other: u32) {
        let [one, other] = [one, other].map(|number| self.first(number));
        self.0[one.max(other) as usize] = one.min(other);
    }

    /// The group of each number that counts, in the order of their first numbers, and how many there are.
    pub(crate) fn labels(&mut self, counts: impl Fn(u32) -> bool) -> (Vec<u32>, usize) {
        let mut labels = vec![NO_GROUP; self.0.len()];
        let mut count = 0;
        for number in (0..self.0.len() as u32).filter(|number| counts(*number)) {
            let first = self.first(number) as usize;
            if labels[first] == NO_GROUP {
                labels[first] = count;
                count += 1;
            }
            labels[number as usize] = labels[first];
        }
        (labels, count as usize)
    }
}
