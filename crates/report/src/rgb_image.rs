//! Images of red, green and blue bytes, in memory.

/// An image of red, green and blue bytes, row by row from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RgbImage {
    width: u32,
    pixels: Vec<[u8; 3]>,
}

impl RgbImage {
    /// An image of one colour.
    ///
    /// # Panics
    /// Without a column.
    pub fn from_pixel(width: u32, height: u32, color: [u8; 3]) -> Self {
        Self::from_fn(width, height, |_, _| color)
    }

    /// The image whose pixel in column `x` and row `y` is `color(x, y)`.
    ///
    /// # Panics
    /// Without a column.
    pub fn from_fn(width: u32, height: u32, mut color: impl FnMut(u32, u32) -> [u8; 3]) -> Self {
        assert!(width > 0, "an image has columns, and this has none");
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        (0..height).for_each(|y| pixels.extend((0..width).map(|x| color(x, y))));
        Self { width, pixels }
    }

    /// Columns.
    pub const fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub const fn height(&self) -> u32 {
        (self.pixels.len() / self.width as usize) as u32
    }

    /// Where the pixels of a row lie.
    fn row(&self, x: u32, y: u32, width: u32) -> std::ops::Range<usize> {
        assert!(x + width <= self.width, "columns {x} to {} of {}", x + width, self.width);
        let start = y as usize * self.width as usize + x as usize;
        start..start + width as usize
    }

    /// The pixel in column `x` and row `y`.
    ///
    /// # Panics
    /// Outside of the image.
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        self.pixels[self.row(x, y, 1).start]
    }

    /// Gives the pixel in column `x` and row `y` a colour.
    ///
    /// # Panics
    /// Outside of the image.
    pub fn set_pixel(&mut self, x: u32, y: u32, color: [u8; 3]) {
        let index = self.row(x, y, 1).start;
        self.pixels[index] = color;
    }

    /// All pixels, row by row.
    pub fn pixels_mut(&mut self) -> impl Iterator<Item = &mut [u8; 3]> {
        self.pixels.iter_mut()
    }

    /// Puts an image into this one, with its first pixel in column `x` and row `y`.
    ///
    /// # Panics
    /// Where it reaches beyond this one.
    pub fn replace(&mut self, image: &Self, [x, y]: [u32; 2]) {
        for (row, pixels) in image.pixels.chunks_exact(image.width as usize).enumerate() {
            let range = self.row(x, y + row as u32, image.width);
            self.pixels[range].copy_from_slice(pixels);
        }
    }

    /// The part of `width` x `height` pixels whose first is in column `x` and row `y`.
    ///
    /// # Panics
    /// Where it reaches beyond the image.
    pub fn crop(&self, [x, y, width, height]: [u32; 4]) -> Self {
        let rows = (y..y + height).flat_map(|y| &self.pixels[self.row(x, y, width)]);
        Self { width, pixels: rows.copied().collect() }
    }

    /// Red, green and blue of all pixels, row by row.
    pub fn bytes(&self) -> &[u8] {
        self.pixels.as_flattened()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_that_is_put_elsewhere_is_that_part() {
        let image = RgbImage::from_fn(5, 4, |x, y| [x as u8, y as u8, 7]);
        assert_eq!((image.width(), image.height(), image.bytes().len()), (5, 4, 60));
        let part = image.crop([1, 2, 3, 2]);
        assert_eq!(part, RgbImage::from_fn(3, 2, |x, y| [x as u8 + 1, y as u8 + 2, 7]));
        let mut other = RgbImage::from_pixel(6, 5, [9; 3]);
        other.replace(&part, [3, 3]);
        assert_eq!(other.crop([3, 3, 3, 2]), part);
        let kept = (0..30).filter(|k| other.pixel(k % 6, k / 6) == [9; 3]).count();
        assert_eq!(kept, 24);
    }
}
