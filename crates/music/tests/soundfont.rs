//! Sound from a SoundFont, on the smallest one there can be: a single preset of one looped square
//! wave.

#![allow(clippy::unwrap_used, reason = "an unwrap that fails fails the test")]

use etude_music::Note;
use etude_music::sound::{self, SoundError, SoundFont};

const SAMPLES: u32 = 4410;
/// Length of a period of the wave, in samples: its pitch is 441 Hz, close to A4.
const PERIOD: u32 = 100;
const ROOT_PITCH: u8 = 69;

fn chunk(kind: &[u8; 4], body: &[u8]) -> Vec<u8> {
    [kind, (body.len() as u32).to_le_bytes().as_slice(), body].concat()
}

fn list(kind: &[u8; 4], chunks: &[Vec<u8>]) -> Vec<u8> {
    chunk(b"LIST", &[kind.as_slice(), &chunks.concat()].concat())
}

fn words(words: &[u16]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

fn name(text: &str) -> Vec<u8> {
    let mut name = text.as_bytes().to_vec();
    name.resize(20, 0);
    name
}

/// The bytes of the font; its samples begin with `first`.
fn font(first: &[u8; 4]) -> Vec<u8> {
    let wave = (0..SAMPLES).map(|i| if i % PERIOD < PERIOD / 2 { 8000i16 } else { -8000 });
    let mut wave: Vec<u8> = wave.flat_map(i16::to_le_bytes).collect();
    if first != b"wave" {
        wave[..4].copy_from_slice(first);
    }
    wave.extend([0; 92]);

    let preset = |text, bag: u16| [name(text), words(&[0, 0, bag, 0, 0, 0, 0, 0, 0])].concat();
    let instrument = |text, bag: u16| [name(text), words(&[bag])].concat();
    let sample = |text, [start, end, loop_start, loop_end, rate]: [u32; 5]| {
        let numbers = [start, end, loop_start, loop_end, rate].map(u32::to_le_bytes).concat();
        [name(text), numbers, vec![ROOT_PITCH, 0], words(&[0, 1])].concat()
    };
    const INSTRUMENT: u16 = 41;
    const SAMPLE_MODES: u16 = 54;
    const SAMPLE_ID: u16 = 53;
    let body = [
        b"sfbk".to_vec(),
        list(
            b"INFO",
            &[chunk(b"ifil", &words(&[2, 1])), chunk(b"isng", b"EMU8000\0"), chunk(b"INAM", b"tiny\0\0")],
        ),
        list(b"sdta", &[chunk(b"smpl", &wave)]),
        list(
            b"pdta",
            &[
                chunk(b"phdr", &[preset("Piano", 0), preset("EOP", 1)].concat()),
                chunk(b"pbag", &words(&[0, 0, 1, 0])),
                chunk(b"pmod", &[0; 10]),
                chunk(b"pgen", &words(&[INSTRUMENT, 0, 0, 0])),
                chunk(b"inst", &[instrument("Square", 0), instrument("EOI", 1)].concat()),
                chunk(b"ibag", &words(&[0, 0, 2, 0])),
                chunk(b"imod", &[0; 10]),
                chunk(b"igen", &words(&[SAMPLE_MODES, 1, SAMPLE_ID, 0, 0, 0])),
                chunk(
                    b"shdr",
                    &[sample("wave", [0, SAMPLES, PERIOD, PERIOD * 40, 44_100]), sample("EOS", [0; 5])]
                        .concat(),
                ),
            ],
        ),
    ]
    .concat();
    chunk(b"RIFF", &body)
}

fn load(bytes: &[u8]) -> Result<SoundFont, SoundError> {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    SoundFont::load(file.path())
}

fn upward_crossings(samples: &[f32]) -> usize {
    samples.windows(2).filter(|pair| pair[0] < 0.0 && pair[1] >= 0.0).count()
}

#[test]
fn a_soundfont_plays_the_right_pitch_at_the_right_time() {
    let font = load(&font(b"wave")).unwrap();
    let note = |pitch, start_secs, end_secs| Note { pitch, velocity: 100, start_secs, end_secs };
    let notes = [note(69, 0.5, 1.5), note(81, 2.0, 3.0), note(81, 3.0, 3.5)];
    let samples = sound::render(&notes, Some(&font)).unwrap();
    assert_eq!(samples.len(), (4.5 * f64::from(sound::SAMPLE_RATE_HZ)) as usize);
    let part = |from: f64, to: f64| {
        let at = |secs: f64| (secs * f64::from(sound::SAMPLE_RATE_HZ)) as usize;
        &samples[at(from)..at(to)]
    };
    assert!(part(0.0, 0.49).iter().all(|sample| sample.abs() < 1e-3));
    assert!((85..=91).contains(&upward_crossings(part(1.0, 1.2))), "{}", upward_crossings(part(1.0, 1.2)));
    assert!((173..=180).contains(&upward_crossings(part(2.5, 2.7))));
    assert!((173..=180).contains(&upward_crossings(part(3.2, 3.4))));
    assert!(part(4.2, 4.5).iter().all(|sample| sample.abs() < 0.05));
}

#[test]
fn a_compressed_or_broken_soundfont_is_refused_with_advice() {
    let compressed = load(&font(b"OggS")).unwrap_err();
    assert!(matches!(compressed, SoundError::Compressed { .. }), "{compressed}");
    assert!(compressed.to_string().contains("use an SF2 file"), "{compressed}");
    let whole = font(b"wave");
    for length in (0..whole.len()).step_by(7) {
        assert!(load(&whole[..length]).is_err(), "cut to {length} bytes");
    }
}

#[test]
fn a_soundfont_that_points_nowhere_is_an_error() {
    let mut bytes = font(b"wave");
    // The number of zones that the last preset record claims lies behind its name, preset and bank.
    let last_preset = bytes.windows(3).position(|text| text == b"EOP").unwrap();
    bytes[last_preset + 24] = 200;
    let damaged = load(&bytes).unwrap_err();
    assert!(damaged.to_string().contains("is not a usable SoundFont: it is damaged inside;"), "{damaged}");
}
