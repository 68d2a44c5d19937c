//! JSON messages in, the numbers at the wanted paths out, without building a value tree.
//!
//! The layout of a message (the text between its scalars) is learnt once; messages of the same
//! layout are compared with it bytewise, and only the wanted scalars are parsed. A message of
//! another layout is learnt anew.

mod fields;
mod layout;

use super::encoding::{DAMAGED, Encoding, Prepared, Reader};
use crate::log::channel::Channel;
use layout::Layout;
use std::sync::Arc;

pub const ENCODING: Encoding =
    Encoding { message: "json", schemas: &["jsonschema", ""], fields: fields::among, prepare };

fn prepare(_: &Channel, paths: &[String]) -> Result<Prepared, String> {
    let paths: Arc<[String]> = paths.into();
    Ok(Box::new(move || reader(paths.clone())))
}

fn reader(paths: Arc<[String]>) -> Reader {
    let mut layout: Option<Layout> = None;
    Box::new(move |message, out| {
        if layout.as_ref().is_some_and(|l| l.read(message, out)) {
            return;
        }
        layout = Layout::learn(message, &paths);
        if !layout.as_ref().is_some_and(|l| l.read(message, out)) {
            out.fill(DAMAGED);
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_all(messages: &[&str], paths: &[&str]) -> Vec<Vec<String>> {
        let paths: Arc<[String]> = paths.iter().map(|p| p.to_string()).collect();
        let mut read = reader(paths.clone());
        let word = |x: &f64| {
            if crate::log::decode::is_unreadable(*x) {
                "unreadable".to_string()
            } else {
                x.to_string()
            }
        };
        let one = |m: &&str| {
            let mut out = vec![0.0; paths.len()];
            read(m.as_bytes(), &mut out);
            out.iter().map(word).collect()
        };
        messages.iter().map(one).collect()
    }

    #[test]
    fn nested_paths_lists_and_changing_layouts() {
        let got = read_all(
            &[
                r#"{"a":{"b":1.5,"c":[10,20]},"s":"x"}"#,
                r#"{"a":{"b":-2e-3,"c":[11,21]},"s":"a \"longer\" text"}"#,
                r#"{"s":"y", "a":{"c":[12],"b":7}}"#,
                r#"{"a":{"b":3,"c":[13,23]},"s":"x"}"#,
                r#"{"a.b":4}"#,
            ],
            &["a.b", "a.c.1"],
        );
        assert_eq!(
            got,
            [
                ["1.5", "20"],
                ["-0.002", "21"],
                ["7", "unreadable"],
                ["3", "23"],
                ["4", "unreadable"]
            ]
        );
    }

    #[test]
    fn every_way_recorders_write_nan() {
        let got = read_all(
            &[
                r#"{"a":1}"#,
                r#"{"a":null}"#,
                r#"{"a":NaN}"#,
                r#"{"a":-Infinity}"#,
                r#"{"a":"nan"}"#,
                r#"{"a":"2.5"}"#,
                r#"{"a":1e999}"#,
                r#"{"a":true}"#,
            ],
            &["a"],
        );
        assert_eq!(got, [["1"], ["NaN"], ["NaN"], ["NaN"], ["NaN"], ["2.5"], ["NaN"], ["1"]]);
    }

    #[test]
    fn broken_messages_are_unreadable_and_the_next_one_is_read() {
        let deep = "[".repeat(100_000);
        let broken = [
            "{",
            r#"{"a":}"#,
            r#"{"a":1"#,
            r#"{"a":1}x"#,
            r#"{"a":"off"}"#,
            r#"{"a":{}}"#,
            r#"{"a":1.2.3}"#,
            "",
            "\"",
            "{\"a\":\"\\",
            &deep,
        ];
        for b in broken {
            assert_eq!(
                read_all(&[r#"{"a":5}"#, b, r#"{"a":6}"#], &["a"]),
                [["5"], ["unreadable"], ["6"]],
                "{b:.20}"
            );
        }
    }

    proptest::proptest! {
        #[test]
        fn any_bytes_are_read_without_panic(bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..60)) {
            let mut read = reader(["a".to_string()].into());
            let mut out = [0.0];
            read(br#"{"a":1,"b":"x"}"#, &mut out);
            read(&bytes, &mut out);
            let mut near = br#"{"a":1,"b":"x"}"#.to_vec();
            near.splice(5..6, bytes);
            read(&near, &mut out);
            proptest::prop_assert!(!out[0].is_infinite());
        }

        #[test]
        fn numbers_are_read_to_the_last_bit(x in proptest::num::f64::NORMAL, y in proptest::num::f64::NORMAL) {
            let mut read = reader(["a".to_string(), "b".to_string()].into());
            let mut out = [0.0; 2];
            read(br#"{"a":1,"b":2}"#, &mut out);
            read(format!("{{\"a\":{x:e},\"b\":{y}}}").as_bytes(), &mut out);
            proptest::prop_assert_eq!(out, [x, y]);
        }
    }
}
