//! Mutual TLS, with certificates that are thrown away.

use crate::campaign::{Campaign, assert_same, left};
use crate::processes::{Cluster, worker};
use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, IsCa, KeyPair};
use std::path::Path;

/// An authority and one member of it, in a folder.
fn certificates(folder: &Path) {
    std::fs::create_dir_all(folder).expect("made");
    let key = KeyPair::generate().expect("a key");
    let mut params = CertificateParams::new(Vec::<String>::new()).expect("parameters");
    params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
    let authority = CertifiedIssuer::self_signed(params, key).expect("signed");
    let key = KeyPair::generate().expect("a key");
    let params = CertificateParams::new(["koehler-cluster".to_string()]).expect("parameters");
    let member = params.signed_by(&key, &authority).expect("signed");
    let write = |name: &str, text: String| std::fs::write(folder.join(name), text);
    write("ca.pem", authority.pem()).expect("written");
    write("member.pem", member.pem()).expect("written");
    write("member.key", key.serialize_pem()).expect("written");
}

#[test]
fn members_work_together_and_strangers_do_not() {
    let campaign = Campaign::of(2);
    let (alone, _) = campaign.alone();
    let (ours, others) = (campaign.path("ours"), campaign.path("others"));
    certificates(&ours);
    certificates(&others);
    let ours = ours.to_str().expect("text");
    let cluster = Cluster::with(&campaign, 1, &["--tls", ours]);
    let args = ["--cluster", &cluster.address, "--tls", ours];
    let output = campaign.run("there", &args).output().expect("run");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(!String::from_utf8_lossy(&output.stderr).contains("done here"), "{output:?}");
    assert_same(&alone, &left(&campaign.path("there")));
    // Certificates of another authority, and none at all.
    for tls in [&["--tls", others.to_str().expect("text")][..], &[]] {
        let args = [&["--cluster", cluster.address.as_str()], tls].concat();
        let output = campaign.run("elsewhere", &args).output().expect("run");
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        let mut stranger = worker(&campaign.path(""), &cluster.address);
        let output = stranger.args(tls).output().expect("run");
        assert_eq!(output.status.code(), Some(2), "{output:?}");
    }
}
