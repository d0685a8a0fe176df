//! What image files say that is not done, in words: orientation, colour profiles, pixels that are no squares,
//! further layers and images.
//!
//! # Sources
//! PNG, third edition, 11.3 (`cICP`, `iCCP`, `sRGB`, `gAMA`, `cHRM`, `pHYs`, `acTL`; the first of the colours'
//! counts); Exif 2.32 (`ColorSpace`); JFIF 1.02 (densities); ICC.1:2022 (tag `desc`).

use std::path::Path;

use super::decode::{Format, header};
use super::header::Header;
use super::samples::{Picture, guarded};
use super::usual::{self, is_srgb};
use super::{open_exr, radiance};
use crate::error::{Location, SceneError};
use crate::folder::Folder;

/// What becomes of numbers whose meaning is left out.
const TAKEN: &str = "numbers are taken as sRGB, or as `color_space` says";
/// sRGB's nearest power, and how far from it a file's may be: some write 1/2.2 in two digits.
const GAMMA: f64 = 1.0 / 2.2;
const SAME_GAMMA: f64 = 0.01;

impl Picture {
    /// What the file of these `bytes` says that [`Picture::decode`] does not do, a sentence each.
    ///
    /// # Errors
    /// As [`Picture::decode_size`].
    pub fn remarks(bytes: &[u8], location: &Location) -> Result<Vec<String>, SceneError> {
        match Format::detect(bytes, location)? {
            Format::Exr => guarded(location, || open_exr::remarks(bytes, location)),
            Format::Radiance => guarded(location, || radiance::remarks(bytes, location)),
            Format::Png => {
                let header = header(bytes, bytes.len(), location)?;
                let mut remarks = Vec::from_iter(color_remark(&header));
                remarks.extend(png_remarks(bytes, !remarks.is_empty()));
                Ok(with_turn(remarks, &header))
            }
            Format::Jpeg => {
                let header = header(bytes, bytes.len(), location)?;
                let mut remarks = Vec::from_iter(color_remark(&header));
                remarks.extend(jfif_remark(bytes));
                Ok(with_turn(remarks, &header))
            }
        }
    }

    /// As [`Picture::remarks`], of the file at `path`.
    ///
    /// # Errors
    /// As [`Folder::read`] and [`Picture::remarks`].
    pub fn remarks_in(folder: &Folder, path: impl AsRef<Path>) -> Result<Vec<String>, SceneError> {
        let path = path.as_ref();
        Self::remarks(&folder.read(path)?, &Location::new(folder.join(path)))
    }
}

fn with_turn(mut remarks: Vec<String>, header: &Header) -> Vec<String> {
    remarks.extend(header.turn().map(|turn| {
        format!("viewers turn it {turn}, as its Exif data say, and it is read as it is stored")
    }));
    remarks
}

/// The colour profile, or what Exif data say in place of it.
fn color_remark(header: &Header) -> Option<String> {
    if let Some(profile) = &header.profile {
        let name = profile_name(profile).unwrap_or_default();
        let is_usual = name.to_lowercase().contains("srgb");
        return (!is_usual)
            .then(|| format!("it has the colour profile {name:?}, which is left out: {TAKEN}"));
    }
    let space = header.exif()?.color_space()?;
    (space != 1).then(|| {
        format!(
            "its Exif data say another colour space than sRGB, as Adobe RGB, which is left out: {TAKEN}"
        )
    })
}

/// The chunks of a PNG before its pixels: the name and the data of each.
fn chunks(bytes: &[u8]) -> impl Iterator<Item = (&[u8], &[u8])> {
    let mut rest = bytes.get(8..).unwrap_or_default();
    std::iter::from_fn(move || {
        let (length, after) = rest.split_first_chunk::<4>()?;
        let (name, after) = after.split_at_checked(4)?;
        let (data, after) = after.split_at_checked(u32::from_be_bytes(*length) as usize)?;
        rest = after.get(4..)?;
        Some((name, data))
    })
    .take_while(|(name, _)| *name != b"IDAT")
}

/// What a PNG says beside its colour profile, of whose colours enough may be said.
fn png_remarks(bytes: &[u8], has_said: bool) -> Vec<String> {
    let find =
        |name: &[u8; 4]| chunks(bytes).find(|(known, _)| known == name).map(|(_, data)| data);
    let number = |data: &[u8], index: usize| {
        let bytes = data.get(4 * index..4 * index + 4)?;
        Some(f64::from(u32::from_be_bytes(bytes.try_into().ok()?)))
    };
    let mut remarks = Vec::new();
    if let Some(&[primaries, transfer, ..]) = find(b"cICP") {
        if [primaries, transfer] != [1, 13] {
            remarks.push(format!(
                "it says primaries {primaries} and transfer {transfer} (cICP), which is left out: {TAKEN}"
            ));
        }
    } else if !has_said && find(b"iCCP").is_none() && find(b"sRGB").is_none() {
        let gamma = find(b"gAMA").and_then(|data| number(data, 0)).map(|gamma| gamma / 1e5);
        if let Some(gamma) = gamma.filter(|gamma| (gamma - GAMMA).abs() > SAME_GAMMA) {
            remarks.push(format!("it says gamma {gamma}, which is left out: {TAKEN}"));
        }
        let colors = find(b"cHRM")
            .map(|data| std::array::from_fn(|k| number(data, k).unwrap_or_default() as f32 / 1e5));
        if colors.is_some_and(|colors| !is_srgb(colors)) {
            remarks
                .push(format!("it says other primaries than sRGB's, which is left out: {TAKEN}"));
        }
    }
    if let Some(data) = find(b"pHYs")
        && let (Some(x), Some(y)) = (number(data, 0), number(data, 1))
        && x > 0.0
        && y > 0.0
    {
        // So many pixels in a unit of length.
        remarks.extend(usual::aspect_remark(y / x));
    }
    if find(b"acTL").is_some() {
        remarks.push("it is an animation, of which the first image is read".to_owned());
    }
    remarks
}

/// The shape of a JPEG's pixels, from the segment of JFIF that follows its first marker.
fn jfif_remark(bytes: &[u8]) -> Option<String> {
    let segment = bytes.get(2..)?.strip_prefix(&[0xff, 0xe0])?;
    let fields = segment.get(2..)?.strip_prefix(b"JFIF\0")?;
    let &[_, _, _, x1, x0, y1, y0, ..] = fields else { return None };
    let [x, y] = [[x1, x0], [y1, y0]].map(|bytes| f64::from(u16::from_be_bytes(bytes)));
    if x > 0.0 && y > 0.0 { usual::aspect_remark(y / x) } else { None }
}

/// The name in a colour profile.
fn profile_name(profile: &[u8]) -> Option<String> {
    let number = |offset: usize| {
        Some(u32::from_be_bytes(profile.get(offset..offset.checked_add(4)?)?.try_into().ok()?)
            as usize)
    };
    // After the header come how many tags there are, and of each its name, place and length.
    let tags = (0..number(128)?.min(100)).map(|k| 132 + 12 * k);
    let tag = tags.into_iter().find(|&offset| profile.get(offset..offset + 4) == Some(b"desc"))?;
    let offset = number(tag + 4)?;
    let tag_data = profile.get(offset..offset.checked_add(number(tag + 8)?)?)?;
    let within = |from: usize, length: usize| tag_data.get(from..from.checked_add(length)?);
    let field = |from: usize| Some(u32::from_be_bytes(within(from, 4)?.try_into().ok()?) as usize);
    let text = match within(0, 4)? {
        b"desc" => String::from_utf8_lossy(within(12, field(8)?)?).into_owned(),
        b"mluc" => {
            let units = within(field(24)?, field(20)?)?.chunks_exact(2);
            let units: Vec<u16> =
                units.map(|unit| u16::from_be_bytes([unit[0], unit[1]])).collect();
            String::from_utf16_lossy(&units)
        }
        _ => return None,
    };
    Some(text.trim_end_matches('\0').chars().take(60).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Samples;
    use crate::picture::exif::Exif;

    fn png() -> Vec<u8> {
        let samples = Samples::U8(vec![1, 2, 3]);
        let picture = Picture { width: 1, height: 1, channels: 3, samples };
        picture.encode_png(&Location::new("a")).unwrap()
    }

    /// The PNG with further chunks after its header. Readers leave wrong checksums of such chunks to whoever
    /// reads them.
    fn with_chunks(chunks: &[(&[u8; 4], Vec<u8>)]) -> Vec<u8> {
        let plain = png();
        let mut bytes = plain[..33].to_vec();
        for (name, data) in chunks {
            let body = [&name[..], data].concat();
            bytes.extend((data.len() as u32).to_be_bytes());
            bytes.extend(&body);
            bytes.extend(crc32(&body).to_be_bytes());
        }
        bytes.extend(&plain[33..]);
        bytes
    }

    fn crc32(bytes: &[u8]) -> u32 {
        let step = |sum: u32| if sum & 1 == 1 { 0xedb8_8320 ^ (sum >> 1) } else { sum >> 1 };
        let byte = |sum: u32, byte: &u8| (0..8).fold(sum ^ u32::from(*byte), |sum, _| step(sum));
        !bytes.iter().fold(u32::MAX, byte)
    }

    /// A colour profile of this name: the header, one tag, and its text in one of two forms.
    fn profile(name: &str, is_new: bool) -> Vec<u8> {
        let mut tag = match is_new {
            false => [b"desc\0\0\0\0", &(name.len() as u32 + 1).to_be_bytes()[..]].concat(),
            true => {
                let length = 2 * name.len() as u32;
                let numbers = [0, 1, 12, 0x656e_5553, length, 28];
                [&b"mluc"[..], &numbers.map(u32::to_be_bytes).concat()].concat()
            }
        };
        match is_new {
            false => tag.extend(format!("{name}\0").bytes()),
            true => tag.extend(name.encode_utf16().flat_map(u16::to_be_bytes)),
        }
        let mut profile = vec![0; 128];
        profile.extend(1_u32.to_be_bytes());
        profile.extend(b"desc");
        profile.extend(144_u32.to_be_bytes());
        profile.extend((tag.len() as u32).to_be_bytes());
        profile.extend(tag);
        profile
    }

    /// A chunk with a profile, packed without compression.
    fn packed(profile: &[u8]) -> Vec<u8> {
        let length = profile.len() as u16;
        let sum = profile.iter().fold([1_u32, 0], |[a, b], &byte| {
            let a = (a + u32::from(byte)) % 65521;
            [a, (b + a) % 65521]
        });
        let head = [&b"name\0\0\x78\x01\x01"[..], &length.to_le_bytes(), &(!length).to_le_bytes()];
        [&head.concat()[..], profile, &(sum[1] << 16 | sum[0]).to_be_bytes()].concat()
    }

    fn remarks(bytes: &[u8]) -> Vec<String> {
        Picture::remarks(bytes, &Location::new("a.png")).unwrap()
    }

    #[test]
    fn a_plain_image_and_one_of_srgb_say_nothing() {
        assert!(remarks(&png()).is_empty());
        let numbers = [31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000_u32];
        let usual = numbers.map(u32::to_be_bytes).concat();
        let rows = [
            vec![(b"gAMA", 45455_u32.to_be_bytes().to_vec()), (b"cHRM", usual)],
            vec![(b"sRGB", vec![0]), (b"gAMA", 100_000_u32.to_be_bytes().to_vec())],
            vec![(b"cICP", vec![1, 13, 0, 1]), (b"gAMA", 100_000_u32.to_be_bytes().to_vec())],
            vec![(b"iCCP", packed(&profile("sRGB IEC61966-2.1", false)))],
            vec![(b"iCCP", packed(&profile("sRGB2014", true)))],
            vec![(
                b"pHYs",
                [2835_u32.to_be_bytes().to_vec(), 2835_u32.to_be_bytes().to_vec(), vec![1]]
                    .concat(),
            )],
        ];
        for chunks in rows {
            let bytes = with_chunks(&chunks);
            assert!(Picture::decode(&bytes, &Location::new("a")).is_ok());
            assert!(remarks(&bytes).is_empty(), "{:?}", remarks(&bytes));
        }
    }

    #[test]
    fn what_else_a_png_says_is_told() {
        let numbers = [31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000_u32];
        let p3 = numbers.map(u32::to_be_bytes).concat();
        let aspect = [1_u32, 2].map(u32::to_be_bytes).concat();
        let rows = [
            ((b"gAMA", 100_000_u32.to_be_bytes().to_vec()), "it says gamma 1, "),
            ((b"cHRM", p3), "it says other primaries"),
            ((b"cICP", vec![12, 13, 0, 1]), "primaries 12 and transfer 13"),
            ((b"iCCP", packed(&profile("Display P3", false))), "profile \"Display P3\""),
            ((b"iCCP", packed(&profile("Display P3", true))), "profile \"Display P3\""),
            ((b"pHYs", [aspect, vec![0]].concat()), "2.0000 times as wide as high"),
        ];
        for (chunk, rule) in rows {
            let bytes = with_chunks(&[chunk]);
            let all = remarks(&bytes);
            assert!(all.len() == 1 && all[0].contains(rule), "{rule}: {all:?}");
        }
    }

    #[test]
    fn exif_data_say_a_colour_space() {
        for (is_little, space) in [(true, 1), (false, 1), (true, 0xffff), (false, 2)] {
            let [short, long] = match is_little {
                true => {
                    [|x: u32| (x as u16).to_le_bytes().to_vec(), |x: u32| x.to_le_bytes().to_vec()]
                }
                false => {
                    [|x: u32| (x as u16).to_be_bytes().to_vec(), |x: u32| x.to_be_bytes().to_vec()]
                }
            };
            let start = if is_little { &b"II"[..] } else { b"MM" };
            // One entry that leads to a list, and that list with one entry.
            let exif = [
                start.to_vec(),
                short(42),
                long(8),
                short(1),
                [short(0x8769), short(4), long(1), long(26)].concat(),
                long(0),
                short(1),
                [short(0xa001), short(3), long(1), short(space), short(0)].concat(),
                long(0),
            ]
            .concat();
            assert_eq!(Exif::new(&exif).unwrap().color_space(), Some(space as u16));
            let all = remarks(&with_chunks(&[(b"eXIf", exif.clone())]));
            assert_eq!(all.len(), usize::from(space != 1), "{all:?}");
            for length in 0..exif.len() {
                let _ = Exif::new(&exif[..length]).and_then(Exif::color_space);
            }
        }
    }

    #[test]
    fn a_profile_that_is_broken_has_no_name() {
        for is_new in [false, true] {
            let whole = profile("Adobe RGB (1998)", is_new);
            assert_eq!(profile_name(&whole).as_deref(), Some("Adobe RGB (1998)"));
            for at in 0..whole.len() {
                let _ = profile_name(&whole[..at]);
                let mut bytes = whole.clone();
                bytes[at] = 255;
                let _ = profile_name(&bytes);
            }
        }
    }
}
