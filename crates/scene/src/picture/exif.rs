//! Numbers of Exif data: lists of tags as in a TIFF, in either order of bytes.
//!
//! # Source
//! Exif 2.32, 4.6.2 (an entry has a tag, a type, a count and a value), 4.6.3 (`Exif IFD Pointer`), 4.6.4
//! (`Orientation`), 4.6.5 (`ColorSpace`).

/// The types of an entry.
const SHORT: u16 = 3;
const LONG: u16 = 4;

/// Exif data whose first bytes are those of Exif data.
#[derive(Clone, Copy)]
pub(super) struct Exif<'b> {
    bytes: &'b [u8],
    is_little: bool,
}

impl<'b> Exif<'b> {
    pub(super) fn new(bytes: &'b [u8]) -> Option<Self> {
        let is_little = bytes.starts_with(b"II*\0");
        (is_little || bytes.starts_with(b"MM\0*")).then_some(Self { bytes, is_little })
    }

    /// How viewers turn the image: 1 to 8.
    pub(super) fn orientation(self) -> Option<u16> {
        self.short(self.value(self.long(4)?, 0x112, SHORT)?)
    }

    /// 1 is sRGB, 65535 what has no number.
    pub(super) fn color_space(self) -> Option<u16> {
        let list = self.long(self.value(self.long(4)?, 0x8769, LONG)?)?;
        self.short(self.value(list, 0xa001, SHORT)?)
    }

    /// Where the single value of a tag stands in the list at `list`.
    fn value(self, list: usize, tag: u16, kind: u16) -> Option<usize> {
        let mut entries = (0..usize::from(self.short(list)?)).map(|k| list + 2 + 12 * k);
        let is = |&entry: &usize| {
            self.short(entry) == Some(tag)
                && self.short(entry + 2) == Some(kind)
                && self.long(entry + 4) == Some(1)
        };
        entries.find(is).map(|entry| entry + 8)
    }

    fn short(self, index: usize) -> Option<u16> {
        let bytes = self.bytes.get(index..index.checked_add(2)?)?.try_into().ok()?;
        Some(if self.is_little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) })
    }

    fn long(self, index: usize) -> Option<usize> {
        let bytes = self.bytes.get(index..index.checked_add(4)?)?.try_into().ok()?;
        let number =
            if self.is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) };
        Some(number as usize)
    }
}
