//! A sound log and a random number generator in; the log with some damage of a kind out.

use rand::RngExt;
use rand_pcg::Pcg64;

pub const KINDS: u64 = 7;

/// Where the records of a sound log begin.
pub fn records(bytes: &[u8]) -> Vec<usize> {
    let (mut all, mut at) = (Vec::new(), 8);
    while at + 17 < bytes.len() {
        all.push(at);
        at += 9 + number(bytes, at + 1) as usize;
    }
    all
}

fn number(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"))
}

/// Several wounds, the first of which is of the seed's kind; `records` is where the sound log's begin.
pub fn damaged(sound: &[u8], records: &[usize], kind: u64, rng: &mut Pcg64) -> Vec<u8> {
    let mut bytes = sound.to_vec();
    for wound in 0..rng.random_range(1..4) {
        damage(&mut bytes, records, (kind + wound * 3) % KINDS, rng);
        if bytes.len() < 100 {
            break;
        }
    }
    bytes
}

/// Flips of bits, of operation codes; a cut, bytes put in, bytes twice, zeroes; sizes that lie.
fn damage(bytes: &mut Vec<u8>, records: &[usize], kind: u64, rng: &mut Pcg64) {
    let at = rng.random_range(8..bytes.len() - 8);
    let n = rng.random_range(1..6000).min(bytes.len() - at);
    let record = records[rng.random_range(0..records.len())].min(bytes.len() - 9);
    match kind {
        0 => (0..rng.random_range(1..20)).for_each(|_| {
            let at = rng.random_range(8..bytes.len());
            bytes[at] ^= 1 << rng.random_range(0..8);
        }),
        1 => bytes[record] = rng.random(),
        2 => bytes.truncate(at),
        3 => drop(bytes.splice(at..at, (0..n).map(|_| rng.random::<u8>()))),
        4 => {
            let again = bytes[at..at + n].to_vec();
            drop(bytes.splice(at..at, again));
        }
        5 => bytes[at..at + n].fill(0),
        _ => {
            let lie = [0, 1, rng.random_range(0..10_000), u64::from(u32::MAX), u64::MAX, 1 << 62];
            let place = record + 1 + [0, 9 + 16, 9 + 16 + 12][rng.random_range(0..3)];
            let lie = lie[rng.random_range(0..lie.len())].to_le_bytes();
            bytes.iter_mut().skip(place).zip(lie).for_each(|(byte, new)| *byte = new);
        }
    }
}
