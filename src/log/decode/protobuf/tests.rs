//! Descriptors and messages made by hand in; the numbers and fields that must come out.

use super::*;
use crate::log::decode::is_unreadable;
use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::source_code_info::Location;
use prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet,
    OneofDescriptorProto, SourceCodeInfo,
};

fn field(name: &str, number: i32, kind: Type) -> FieldDescriptorProto {
    FieldDescriptorProto {
        name: Some(name.into()),
        number: Some(number),
        r#type: Some(kind.into()),
        label: Some(Label::Optional.into()),
        ..Default::default()
    }
}

fn message_field(name: &str, number: i32, of: &str) -> FieldDescriptorProto {
    FieldDescriptorProto { type_name: Some(of.into()), ..field(name, number, Type::Message) }
}

fn repeated(field: FieldDescriptorProto) -> FieldDescriptorProto {
    FieldDescriptorProto { label: Some(Label::Repeated.into()), ..field }
}

fn channel_of(file: FileDescriptorProto) -> Channel {
    Channel {
        topic: "/t".into(),
        message_encoding: "protobuf".into(),
        schema_name: "p.A".into(),
        schema_encoding: "protobuf".into(),
        schema: FileDescriptorSet { file: vec![file] }.encode_to_vec(),
    }
}

/// `message A` of package `p` in proto3.
fn channel() -> Channel {
    let one_of = FieldDescriptorProto { oneof_index: Some(0), ..field("either", 8, Type::Double) };
    let optional = FieldDescriptorProto {
        proto3_optional: Some(true),
        oneof_index: Some(1),
        ..field("perhaps", 9, Type::Float)
    };
    let oneof = |name: &str| OneofDescriptorProto { name: Some(name.into()), ..Default::default() };
    let a = DescriptorProto {
        name: Some("A".into()),
        field: vec![
            field("x", 1, Type::Double),
            field("s", 2, Type::String),
            field("z", 3, Type::Sint32),
            message_field("b", 4, ".p.A.B"),
            repeated(field("list", 5, Type::Int32)),
            repeated(message_field("items", 6, ".p.A.B")),
            field("i", 7, Type::Int64),
            one_of,
            optional,
            repeated(field("f", 10, Type::Float)),
            message_field("again", 11, ".p.A"),
            field("far", 2000, Type::Fixed32),
        ],
        nested_type: vec![DescriptorProto {
            name: Some("B".into()),
            field: vec![field("v", 1, Type::Float), field("on", 2, Type::Bool)],
            ..Default::default()
        }],
        oneof_decl: vec![oneof("o"), oneof("_perhaps")],
        ..Default::default()
    };
    let location = |path: &[i32], text: &str| Location {
        path: path.into(),
        trailing_comments: Some(text.into()),
        ..Default::default()
    };
    channel_of(FileDescriptorProto {
        package: Some("p".into()),
        syntax: Some("proto3".into()),
        message_type: vec![a],
        source_code_info: Some(SourceCodeInfo {
            location: vec![
                location(&[4, 0, 2, 0], " the\n first "),
                location(&[4, 0, 3, 0, 2, 1], "on?"),
            ],
        }),
        ..Default::default()
    })
}

fn values(channel: &Channel, paths: &[&str], message: &[u8]) -> Vec<String> {
    let paths: Vec<String> = paths.iter().map(|p| p.to_string()).collect();
    let mut out = vec![0.0; paths.len()];
    let mut read = prepare(channel, &paths).unwrap()();
    // What a message before this one said counts for nothing.
    read(&[0x28, 77, 0x39, 1, 1, 1, 1, 1, 1, 1, 1], &mut out);
    read(message, &mut out);
    let word = |x: &f64| if is_unreadable(*x) { "no".to_string() } else { x.to_string() };
    out.iter().map(word).collect()
}

/// A message with everything in it; the message `b` in two pieces, the list in three.
fn full() -> Vec<u8> {
    let mut m = vec![0x09];
    m.extend(1.5f64.to_le_bytes());
    m.extend([0x12, 2, b'h', b'i']);
    m.extend([0x18, 3]); // -2
    m.extend([0x22, 5, 0x0d]);
    m.extend(2.5f32.to_le_bytes());
    m.extend([0x22, 2, 0x10, 1]);
    m.extend([
        0x2a, 2, 1, 2, 0x28, 3, 0x2a, 10, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1,
    ]);
    m.extend([0x32, 0, 0x32, 2, 0x10, 1]);
    m.extend([0x38, 0x80, 1]);
    m.extend([0x41, 0, 0, 0, 0, 0, 0, 0xf0, 0x7f]); // infinite
    m.extend([0x4d, 0, 0, 0, 0]);
    m.extend([0x52, 8, 0, 0, 0x80, 0x3f, 0, 0, 0, 0x40]);
    m.extend([0x5a, 9, 0x09]);
    m.extend(9f64.to_le_bytes());
    m.extend([0x85, 0x7d, 7, 0, 0, 0]);
    // a field that the schema does not have, and a group
    m.extend([0xf8, 0x7f, 1, 0xf3, 0x7f, 0x08, 1, 0xf4, 0x7f]);
    m
}

const PATHS: [&str; 20] = [
    "x",
    "z",
    "b.v",
    "b.on",
    "list.0",
    "list.2",
    "list.3",
    "list.4",
    "items.0.on",
    "items.1.on",
    "items.1.v",
    "items.2.v",
    "i",
    "either",
    "perhaps",
    "f.1",
    "again.x",
    "again.b.v",
    "far",
    "s",
];

#[test]
fn every_number_is_found() {
    let got = values(&channel(), &PATHS, &full());
    let wanted = [
        "1.5", "-2", "2.5", "1", "1", "3", "-1", "no", "0", "1", "0", "no", "128", "NaN", "0", "2",
        "9", "no", "7", "no",
    ];
    assert_eq!(got, wanted);
}

#[test]
fn what_is_left_out_is_the_default_where_the_field_has_no_presence() {
    let got = values(&channel(), &PATHS, &[]);
    let zero = ["x", "z", "i", "far"];
    let wanted: Vec<&str> =
        PATHS.iter().map(|p| if zero.contains(p) { "0" } else { "no" }).collect();
    assert_eq!(got, wanted);
    // before proto3 a field that is left out is its default, if the schema names one
    let old = FileDescriptorProto {
        package: Some("p".into()),
        message_type: vec![DescriptorProto {
            name: Some("A".into()),
            field: vec![
                field("x", 1, Type::Double),
                FieldDescriptorProto {
                    default_value: Some("-2.5".into()),
                    ..field("y", 2, Type::Double)
                },
                FieldDescriptorProto {
                    default_value: Some("true".into()),
                    ..field("on", 3, Type::Bool)
                },
            ],
            ..Default::default()
        }],
        ..Default::default()
    };
    assert_eq!(values(&channel_of(old), &["x", "y", "on"], &[]), ["no", "-2.5", "1"]);
}

#[test]
fn fields_are_those_of_the_schema_with_the_lengths_of_the_message() {
    let listed = |message: Option<&[u8]>| {
        fields::among(&channel(), message.as_slice())
            .into_iter()
            .map(|f| f.path)
            .collect::<Vec<_>>()
            .join(" ")
    };
    assert_eq!(listed(None), "x z b.v b.on list.* items.*.v items.*.on i either perhaps f.* far");
    assert_eq!(
        listed(Some(&full())),
        "x z b.v b.on list.0 list.1 list.2 list.3 items.0.v items.0.on items.1.v items.1.on i either perhaps \
         f.0 f.1 again.x again.z again.b.v again.b.on again.i again.either again.perhaps again.far far"
    );
    let told = fields::among(&channel(), &[]);
    assert_eq!((told[0].doc.as_str(), told[3].doc.as_str()), ("the first", "on?"));
}

#[test]
fn lists_that_begin_empty_are_listed_from_later_messages() {
    let (full, empty) = (full(), Vec::new());
    let listed = |messages: &[&[u8]]| {
        fields::among(&channel(), messages).into_iter().map(|f| f.path).collect::<Vec<_>>()
    };
    assert!(!listed(&[&empty]).contains(&"list.0".to_string()));
    assert!(listed(&[&empty, &full]).contains(&"list.3".to_string()));
}

#[test]
fn a_damaged_message_is_unreadable_as_a_whole_and_the_next_one_is_read() {
    let whole = full();
    let (channel, paths) = (channel(), ["x".to_string(), "far".to_string()]);
    let mut read = prepare(&channel, &paths).unwrap()();
    let mut out = [0.0; 2];
    let ends: Vec<usize> = (0..=whole.len())
        .filter(|&n| {
            read(&whole[..n], &mut out);
            !out.iter().any(|x| is_unreadable(*x))
        })
        .collect();
    // It can be cut between two fields only.
    assert_eq!(ends.len(), 19, "{ends:?}");
    let broken: [&[u8]; 9] = [
        &[0x0d, 0, 0, 0, 0],             // x in four bytes
        &[0x09, 1],                      // too short
        &[0x0a, 0xff, 0xff, 0xff, 0x7f], // a length that lies
        &[0x08, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 2],
        &[0x00, 1],                                     // field 0
        &[0x09, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0], // field 0 where a high one would be
        &[0x0e],                                        // a kind that is none
        &[0x0c],                                        // the end of no group
        &[0xf3, 0x7f, 0xfc, 0x7f],                      // a group that ends as another
    ];
    for bytes in broken {
        read(bytes, &mut out);
        assert!(out.iter().all(|x| is_unreadable(*x)), "{bytes:?}");
        read(&whole, &mut out);
        assert_eq!(out, [1.5, 7.0]);
    }
    read(&vec![0xf3; 100_000], &mut out);
    assert!(is_unreadable(out[0]));
}

#[test]
fn doubles_in_a_row_are_read_wherever_the_row_breaks() {
    let a = DescriptorProto {
        name: Some("A".into()),
        field: (1..=5).map(|n| field(&format!("d{n}"), n, Type::Double)).collect(),
        ..Default::default()
    };
    let channel = channel_of(FileDescriptorProto {
        package: Some("p".into()),
        syntax: Some("proto3".into()),
        message_type: vec![a],
        ..Default::default()
    });
    let one = |n: &u8| [&[n << 3 | 1][..], &f64::from(*n).to_le_bytes()].concat();
    let message = |order: &[u8]| order.iter().flat_map(one).collect::<Vec<u8>>();
    // The slots need not be in the order of the schema.
    let paths = ["d5", "d1", "d2", "d3", "d4"];
    let read = |order: &[u8]| values(&channel, &paths, &message(order)).join(" ");
    assert_eq!(read(&[1, 2, 3, 4, 5]), "5 1 2 3 4");
    assert_eq!(read(&[1, 2, 4, 5]), "5 1 2 0 4");
    assert_eq!(read(&[5, 4, 3, 2, 1]), "5 1 2 3 4");
    assert_eq!(read(&[1, 2, 1, 9, 2, 3]), "0 1 2 3 0");
    assert_eq!(values(&channel, &paths, &message(&[1, 2, 3])[..26]), ["no"; 5]);
}

#[test]
fn a_wrong_schema_is_said_in_words() {
    let error = |c: &Channel, path: &str| prepare(c, &[path.to_string()]).err().unwrap_or_default();
    let mut none = channel();
    none.schema_name = "p.C".into();
    assert!(error(&none, "x").contains("does not define the message \"p.C\""));
    none.schema = vec![0xff; 9];
    assert!(error(&none, "x").contains("no FileDescriptorSet"));
    assert!(fields::among(&none, &[&full()]).is_empty());
}

proptest::proptest! {
    #[test]
    fn any_bytes_are_read_without_panic(
        at in 0usize..110, bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..12),
    ) {
        let channel = channel();
        let mut message = full();
        message.splice(at.min(message.len())..(at + bytes.len()).min(message.len()), bytes.iter().copied());
        values(&channel, &PATHS, &message);
        fields::among(&channel, &[&message]);
        let mut other = channel.clone();
        let at = at * 5 % other.schema.len();
        other.schema.splice(at..(at + bytes.len()).min(other.schema.len()), bytes.iter().copied());
        if let Ok(prepared) = prepare(&other, &["x".to_string(), "items.1.v".to_string()]) {
            prepared()(&message, &mut [0.0; 2]);
        }
        fields::among(&other, &[&message]);
    }
}

/// A number seven bits at a time.
fn varint(mut left: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while left >= 0x80 {
        bytes.push(left as u8 | 0x80);
        left >>= 7;
    }
    bytes.push(left as u8);
    bytes
}

#[test]
fn whole_numbers_of_a_list_have_what_their_nearest_f64_lacks() {
    let rest = crate::log::decode::rest_of;
    let number = 1_700_000_000_123_456_789_i64;
    let both = [varint(7), varint(number as u64)];
    // the key of `list` as one stretch, and as a number each
    let packed = both.concat();
    let stretch = [vec![0x2a, packed.len() as u8], packed].concat();
    let each = both.map(|n| [vec![0x28], n].concat()).concat();
    let paths = ["list.0".to_string(), rest("list.0"), "list.1".to_string(), rest("list.1")];
    for message in [stretch, each] {
        let mut out = vec![0.0; paths.len()];
        prepare(&channel(), &paths).expect("a plan")()(&message, &mut out);
        assert_eq!(out[..2], [7.0, 0.0]);
        assert!(out[3] != 0.0 && out[2] as i64 + out[3] as i64 == number, "{out:?}");
    }
}

#[test]
fn a_whole_number_of_64_bits_has_what_its_nearest_f64_lacks() {
    let rest = crate::log::decode::rest_of;
    let number = 1_700_000_000_123_456_789_i64;
    // the key of `i`, and the number
    let message = [vec![0x38], varint(number as u64)].concat();
    let paths = ["i".to_string(), rest("i"), "x".to_string(), rest("x"), rest("z")];
    let mut out = vec![0.0; paths.len()];
    prepare(&channel(), &paths).expect("a plan")()(&message, &mut out);
    assert_eq!(out[0] as i64 + out[1] as i64, number);
    assert!(out[1] != 0.0 && out[..3].iter().all(|x| x.is_finite()), "{out:?}");
    // a message without the field
    prepare(&channel(), &paths).expect("a plan")()(&[], &mut out);
    assert_eq!((out[0], out[2]), (0.0, 0.0));
}
