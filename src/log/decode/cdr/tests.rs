//! Definitions and messages made by hand in; the numbers and fields that must come out.

use super::*;
use crate::log::decode::{is_damaged, is_unreadable};

/// A message in the making.
struct Made {
    big: bool,
    bytes: Vec<u8>,
}

impl Made {
    fn new(big: bool) -> Made {
        Made { big, bytes: vec![0, u8::from(!big), 0, 0] }
    }

    /// The bytes of a number, lowest first, aligned to their count.
    fn put<const N: usize>(mut self, mut low_first: [u8; N]) -> Made {
        while !(self.bytes.len() - 4).is_multiple_of(N) {
            self.bytes.push(0);
        }
        if self.big {
            low_first.reverse();
        }
        self.bytes.extend(low_first);
        self
    }

    fn text(self, text: &str) -> Made {
        let mut made = self.put((text.len() as u32 + 1).to_le_bytes());
        made.bytes.extend(text.bytes().chain([0]));
        made
    }
}

fn channel(name: &str, encoding: &str, schema: &str) -> Channel {
    Channel {
        topic: "/t".into(),
        message_encoding: "cdr".into(),
        schema_name: name.into(),
        schema_encoding: encoding.into(),
        schema: schema.as_bytes().to_vec(),
    }
}

fn values(channel: &Channel, paths: &[&str], message: &[u8]) -> Vec<f64> {
    let paths: Vec<String> = paths.iter().map(|p| p.to_string()).collect();
    let mut out = vec![0.0; paths.len()];
    prepare(channel, &paths).unwrap()()(message, &mut out);
    out
}

fn listed(channel: &Channel, message: Option<&[u8]>) -> Vec<String> {
    fields::among(channel, message.as_slice()).into_iter().map(|f| f.path).collect()
}

const STATE: &str = "\
# a comment of the file

int8 GOOD=1
string NAME=\"a # b\"
std_msgs/Header header
uint8 kind 3 # of state
# body axes
Vec[2] v
float32[] list
Item[] items
bool on
int64 n
=======================
MSG: a_msgs/Vec
float64 x
int16 k
=======================
MSG: a_msgs/msg/Item
string<=8 name
float32 value
=======================
MSG: std_msgs/msg/Header
builtin_interfaces/Time stamp
string frame_id
";

fn state(big: bool) -> Vec<u8> {
    Made::new(big)
        .put(7i32.to_le_bytes())
        .put(9u32.to_le_bytes())
        .text("map")
        .put([3u8])
        .put(1.5f64.to_le_bytes())
        .put((-2i16).to_le_bytes())
        .put(2.5f64.to_le_bytes())
        .put(4i16.to_le_bytes())
        .put(3u32.to_le_bytes())
        .put(0.5f32.to_le_bytes())
        .put(f32::INFINITY.to_le_bytes())
        .put(2.5f32.to_le_bytes())
        .put(2u32.to_le_bytes())
        .text("abcdef")
        .put(10f32.to_le_bytes())
        .text("")
        .put(11f32.to_le_bytes())
        .put([1u8])
        .put((-5i64).to_le_bytes())
        .bytes
}

#[test]
fn every_number_is_found_in_both_byte_orders() {
    let channel = channel("a_msgs/msg/State", "ros2msg", STATE);
    let paths = [
        "n",
        "header.stamp.sec",
        "header.stamp.nanosec",
        "kind",
        "v.1.x",
        "v.0.k",
        "v.1.k",
        "list.0",
        "list.1",
        "list.2",
        "items.0.value",
        "items.1.value",
        "on",
        "list.3",
        "items.2.value",
        "v.01.x",
        "nothing",
        "header",
        "items",
    ];
    let wanted = [
        "-5", "7", "9", "3", "2.5", "-2", "4", "0.5", "NaN", "2.5", "10", "11", "1", "no", "no",
        "no", "no", "no", "no",
    ];
    for big in [false, true] {
        let got = values(&channel, &paths, &state(big));
        let word = |x: &f64| if is_unreadable(*x) { "no".into() } else { x.to_string() };
        assert_eq!(got.iter().map(word).collect::<Vec<_>>(), wanted, "big endian: {big}");
    }
}

#[test]
fn fields_come_with_their_comments_and_the_lengths_of_the_message() {
    let channel = channel("a_msgs/msg/State", "ros2msg", STATE);
    let before =
        ["header.stamp.sec", "header.stamp.nanosec", "kind", "v.0.x", "v.0.k", "v.1.x", "v.1.k"];
    let lists = ["list.0", "list.1", "list.2", "items.0.value", "items.1.value"];
    let after = ["on", "n"];
    let all = [&before[..], &lists, &after].concat();
    assert_eq!(listed(&channel, Some(&state(true))), all);
    let unknown = [&before[..], &["list.*", "items.*.value"], &after].concat();
    assert_eq!(listed(&channel, None), unknown);
    assert_eq!(listed(&channel, Some(&state(false)[..30])), unknown);
    let told = fields::among(&channel, &[]);
    assert_eq!((told[0].unit.as_str(), told[2].doc.as_str()), ("", "of state"));
}

#[test]
fn lists_are_as_long_as_in_the_message_with_the_longest_and_damage_says_nothing() {
    let channel = channel("a/B", "ros2msg", "uint8[] list\n");
    let of = |n: u8| [&[0, 1, 0, 0, n, 0, 0, 0][..], &vec![7; usize::from(n)]].concat();
    let (empty, short, long) = (of(0), of(1), of(3));
    let paths = |messages: &[&[u8]]| {
        fields::among(&channel, messages).into_iter().map(|f| f.path).collect::<Vec<_>>()
    };
    assert_eq!(paths(&[&empty, &short, &long[..9], &long]), ["list.0", "list.1", "list.2"]);
    assert_eq!(paths(&[]), ["list.*"]);
    assert!(is_damaged(values(&channel, &["list.0"], &long[..9])[0]));
    let absent = values(&channel, &["list.2"], &short)[0];
    assert!(is_unreadable(absent) && !is_damaged(absent));
}

#[test]
fn a_message_that_is_too_short_too_long_or_of_another_form_is_unreadable_as_a_whole() {
    let channel = channel("a_msgs/msg/State", "ros2msg", STATE);
    let whole = state(false);
    for n in 0..whole.len() {
        let got = values(&channel, &["header.stamp.sec"], &whole[..n]);
        assert!(is_unreadable(got[0]), "{n} bytes");
    }
    let filled = |n: usize| [&whole[..], &vec![0; n]].concat();
    assert_eq!(values(&channel, &["kind"], &filled(7)), [3.0]);
    assert!(is_unreadable(values(&channel, &["kind"], &filled(8))[0]));
    // parameter lists, and the second version of CDR, which aligns otherwise
    for form in [2, 3, 6, 7, 9, 255] {
        let mut other = whole.clone();
        other[1] = form;
        assert!(is_unreadable(values(&channel, &["kind"], &other)[0]), "{form}");
    }
    // a length that lies costs nothing but its message
    let lists = self::channel("a/B", "ros2msg", "float64[] a\nC[] c\n===\nMSG: a/C\nstring s\n");
    for at in [4, 8] {
        let mut lie = vec![0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        assert!(is_unreadable(values(&lists, &["a.0"], &lie)[0]));
        lie[at..at + 4].fill(255);
        assert!(is_unreadable(values(&lists, &["c.0.s"], &lie)[0]));
        assert_eq!(listed(&lists, Some(&lie)), ["a.*"]);
    }
}

#[test]
fn idl_with_modules_annotations_and_typedefs() {
    let text = r#"
================================================================================
IDL: p_msgs/msg/Pose
// generated
#include "p_msgs/msg/Point.idl"
module p_msgs { module msg {
  typedef double double__2[2];
  module Pose_Constants { const uint8 A = 1; };
  @verbatim (language="comment", text= "A pose." "\n" "In a frame.")
  struct Pose {
    @verbatim (language="comment", text="Forward \"x\"")
    @unit (value="m")
    double x;
    @default (value=3)
    unsigned long n, m;
    sequence<p_msgs::msg::Point, 4> points;
    double__2 pair; long long big; octet raw[2][2];
    string<10> name; boolean on; Kind kind; sequence<float> list; Empty nothing; int16 last;
  };
  enum Kind { ONE, TWO };
  struct Empty { uint8 structure_needs_at_least_one_member; };
}; };
=====
IDL: p_msgs/msg/Point
module p_msgs { module msg { /* flat */ struct Point { float x, y; }; }; };
"#;
    let channel = channel("p_msgs/msg/Pose", "ros2idl", text);
    let message = Made::new(true)
        .put(0.25f64.to_le_bytes())
        .put(1u32.to_le_bytes())
        .put(2u32.to_le_bytes())
        .put(1u32.to_le_bytes())
        .put(4f32.to_le_bytes())
        .put(5f32.to_le_bytes())
        .put(6f64.to_le_bytes())
        .put(7f64.to_le_bytes())
        .put((-8i64).to_le_bytes())
        .put([9u8])
        .put([10u8])
        .put([11u8])
        .put([12u8])
        .text("n")
        .put([1u8])
        .put(1u32.to_le_bytes())
        .put(0u32.to_le_bytes())
        .put([0u8])
        .put((-13i16).to_le_bytes())
        .bytes;
    let paths = listed(&channel, Some(&message));
    let wanted = [
        "x",
        "n",
        "m",
        "points.0.x",
        "points.0.y",
        "pair.0",
        "pair.1",
        "big",
        "raw.0.0",
        "raw.0.1",
        "raw.1.0",
        "raw.1.1",
        "on",
        "kind",
        "last",
    ];
    assert_eq!(paths, wanted);
    assert_eq!(
        values(&channel, &wanted, &message),
        [0.25, 1.0, 2.0, 4.0, 5.0, 6.0, 7.0, -8.0, 9.0, 10.0, 11.0, 12.0, 1.0, 1.0, -13.0]
    );
    let x = &fields::among(&channel, &[])[0];
    assert_eq!((x.unit.as_str(), x.doc.as_str()), ("m", "Forward \"x\""));
}

#[test]
fn a_wrong_definition_is_said_in_words() {
    let nested: String = (0..80).map(|i| format!("===\nMSG: a/T{i}\nT{}[9] x\n", i + 1)).collect();
    for (encoding, text, wanted) in [
        ("ros2msg", "float64 x\nBx y\n", "does not define the type \"a/Bx\""),
        ("ros2msg", "float64\n", "\"float64\" of the schema is no field"),
        ("ros2msg", "float64[x] y\n", "is no field"),
        ("ros2msg", "float64[0] y\n", "a list of length 0"),
        ("ros2msg", "C c\n===\nMSG: a/C\nB[] b\n", "contains itself"),
        ("ros2msg", &format!("T0 x\n{nested}"), "nested deeper"),
        ("ros2idl", "module a { struct B { double x };", "\";\" is wanted in the schema"),
        ("ros2idl", "module a { struct B { double x; };", "does not end"),
        ("ros2idl", "module a { struct C { double x; }; };", "does not define the type \"a::B\""),
        ("ros2idl", "struct \"", "does not end"),
    ] {
        let e = prepare(&channel("a/B", encoding, text), &["x".into()]).err().unwrap_or_default();
        assert!(e.contains(wanted), "{text:.40}: {e}");
        assert!(listed(&channel("a/B", encoding, text), None).is_empty());
    }
}

#[test]
fn types_that_multiply_are_walked_in_bounded_time() {
    // 20 levels of three each, without a number; and lists of 10^18 numbers
    let levels: String =
        (0..20).map(|i| format!("===\nMSG: a/T{i}\nT{0} x\nT{0} y\nT{0} z\n", i + 1)).collect();
    let text = format!("T0 x\nfloat64 y\n{levels}===\nMSG: a/T20\nstring s\n");
    let wide = channel("a/B", "ros2msg", &text);
    assert!(listed(&wide, None).is_empty());
    assert!(is_unreadable(values(&wide, &["y"], &[0, 1, 0, 0, 1, 0, 0, 0, 0])[0]));
    let text = "L[1000000000] a\nfloat64 y\n===\nMSG: a/L\nfloat64[1000000000] b\n";
    let long = channel("a/B", "ros2msg", text);
    assert!(listed(&long, None).contains(&"y".to_string()));
    assert!(is_unreadable(values(&long, &["y"], &state(false))[0]));
}

#[test]
fn behind_a_text_of_wide_letters_nothing_is_read() {
    let wide = channel("a/B", "ros2msg", "uint8 x\nwstring w\nuint8 y\n");
    let got = values(&wide, &["x", "y"], &[0, 1, 0, 0, 7, 0, 0, 0, 1, 0, 0, 0, 65, 0, 0, 0, 9]);
    assert!(got[0] == 7.0 && is_unreadable(got[1]));
    assert_eq!(listed(&wide, None), ["x"]);
}

proptest::proptest! {
    #[test]
    fn any_bytes_are_read_without_panic(
        at in 0usize..120, bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..12), big: bool,
    ) {
        let channel = channel("a_msgs/msg/State", "ros2msg", STATE);
        let mut message = state(big);
        let at = at.min(message.len());
        message.splice(at..(at + bytes.len()).min(message.len()), bytes.iter().copied());
        let got = values(&channel, &["n", "items.1.value", "list.2"], &message);
        proptest::prop_assert!(got.iter().all(|x| !x.is_infinite()));
        listed(&channel, Some(&message));
        values(&channel, &["n"], &bytes);
    }

    #[test]
    fn any_definition_is_read_without_panic(
        at in 0usize..400, text in "[ a-z0-9\\[\\]<>=:;{}@(),\"/\\\\#\n]{0,12}",
    ) {
        for (encoding, whole) in [("ros2msg", STATE), ("ros2idl", "module a { @unit(value=\"m\") struct B { sequence<double, 3> x[3]; }; };")] {
            let mut schema = whole.to_string();
            let at = at.min(schema.len());
            schema.replace_range(at..(at + text.len()).min(schema.len()), &text);
            for name in ["a_msgs/msg/State", "a/B"] {
                let channel = channel(name, encoding, &schema);
                if let Ok(prepared) = prepare(&channel, &["n".to_string()]) {
                    prepared()(&state(false), &mut [0.0]);
                }
                listed(&channel, Some(&state(false)));
            }
        }
    }
}

#[test]
fn a_whole_number_of_64_bits_has_what_its_nearest_f64_lacks() {
    let channel = channel("a_msgs/msg/Time", "ros2msg", "int64 n\nuint64 u\nfloat64 f\n");
    let rest = crate::log::decode::rest_of;
    let paths =
        ["n".to_string(), rest("n"), "u".to_string(), rest("u"), "f".to_string(), rest("f")];
    let paths: Vec<&str> = paths.iter().map(String::as_str).collect();
    let (n, u) = (-1_700_000_000_123_456_789_i64, u64::MAX - 5);
    for big in [false, true] {
        let message = Made::new(big).put(n.to_le_bytes()).put(u.to_le_bytes());
        let v = values(&channel, &paths, &message.put(1.5f64.to_le_bytes()).bytes);
        assert_eq!(v[0] as i64 + v[1] as i64, n);
        assert_eq!(v[2] as i128 + v[3] as i128, i128::from(u));
        assert!(v[1] != 0.0 && v[3] != 0.0 && v[4] == 1.5 && is_unreadable(v[5]), "{v:?}");
    }
}

#[test]
fn whole_numbers_of_a_list_have_what_their_nearest_f64_lacks() {
    let channel = channel("a_msgs/msg/Times", "ros2msg", "int64[] n\nuint64[2] u\n");
    let rest = crate::log::decode::rest_of;
    let paths = ["n.1".to_string(), rest("n.1"), "u.0".to_string(), rest("u.0")];
    let paths: Vec<&str> = paths.iter().map(String::as_str).collect();
    let (n, u) = (1_700_000_000_123_456_789_i64, u64::MAX - 5);
    for big in [false, true] {
        let message = Made::new(big).put(2u32.to_le_bytes()).put(7i64.to_le_bytes());
        let message = message.put(n.to_le_bytes()).put(u.to_le_bytes()).put(7u64.to_le_bytes());
        let v = values(&channel, &paths, &message.bytes);
        assert_eq!(v[0] as i64 + v[1] as i64, n);
        assert_eq!(v[2] as i128 + v[3] as i128, i128::from(u));
        assert!(v[1] != 0.0 && v[3] != 0.0, "{v:?}");
    }
}
