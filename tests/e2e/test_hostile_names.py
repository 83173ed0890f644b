"""Files with hostile names go through the whole chain: ESI file, rig, scan, library, FMU, C."""

import json
import os
import subprocess
import tomllib
from html import escape
from pathlib import Path

import pytest
from pymoca.parser import parse

from conftest import run_module
from ecatd.cli.esi_rig import listed, rig

pytestmark = pytest.mark.bus

NAME = 'x"; end P; model Evil\\ */ #error "/*??/ ]]> <b> {{ x }} ${y} \x9b31m \u202e µ'
ESI = """<?xml version="1.0" encoding="utf-8"?>
<EtherCATInfo>
  <Vendor><Id>5</Id><Name>{name}</Name></Vendor>
  <Descriptions>
    <Groups><Group><Type>{name}</Type><Name>{name}</Name></Group></Groups>
    <Devices>
      <Device Physics="YY">
        <Type ProductCode="#x5678" RevisionNo="1">{name}</Type>
        <Name LcId="1033">{name}</Name>
        <GroupType>{name}</GroupType>
        <Sm StartAddress="#x1000" ControlByte="#x20" Enable="1">Inputs</Sm>
        <TxPdo Fixed="1" Mandatory="1" Sm="0">
          <Index>#x1A00</Index><Name>{name}</Name>
          <Entry><Index>#x6000</Index><SubIndex>1</SubIndex><BitLen>8</BitLen>
            <Name>{name}</Name><DataType>USINT</DataType></Entry>
        </TxPdo>
      </Device>
    </Devices>
  </Descriptions>
</EtherCATInfo>
"""


def run(*arguments: str) -> str:
    done = run_module("ecatd.cli", *arguments, env=dict(os.environ))
    assert done.returncode == 0, done.stderr
    assert all(line.isprintable() for line in (done.stdout + done.stderr).split("\n"))
    return done.stdout


def test_an_esi_file_of_hostile_names(tmp_path: Path, compiler: str) -> None:
    esi, scan = tmp_path / "evil.xml", tmp_path / "scan.json"
    esi.write_text(ESI.format(name=escape(NAME)), "utf-8")
    (row,) = tomllib.loads(rig([str(esi)], listed("0x5678")))["slave"]
    assert row["type"] == NAME
    run("scan", "--from", str(esi), "--devices", "0x5678", "-o", str(scan))
    (slave,) = json.loads(scan.read_text())["slaves"]
    assert slave["name"].startswith(NAME[:40])
    run("generate", "P", str(tmp_path), "--from", str(scan))
    run("generate", "P", str(tmp_path), "--from", str(scan), "--fmu")
    for file in (tmp_path / "P").rglob("*.mo"):
        assert set(parse(file.read_text("utf-8")).classes) & {"P", "Evil"} == {"P"}
    header = tmp_path / "image.c"
    header.write_text(run("cstruct", "--from", str(scan)))
    command = [compiler, "-std=c11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", str(header)]
    subprocess.run(command, check=True)
    assert (
        tomllib.loads(run("config", "init", "--from", str(scan)))["slave"][0]["product"] == 0x5678
    )
