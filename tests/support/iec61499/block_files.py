"""A file of a basic block, as 4diac IDE writes it, and lines in such files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

BASIC = """<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<!DOCTYPE FBType SYSTEM "http://www.holobloc.com/xml/LibraryElement.dtd">
<FBType Comment="Scales" Name="SCALE">
  <Identification Description="one&#10;two" Standard="61499-2"/>
  <VersionInfo Author="A" Date="2024-01-02" Organization="O" Remarks="first" Version="1.0"/>
  <CompilerInfo packageName="my::package"><Import declaration="other::TYPE"/></CompilerInfo>
  <InterfaceList>
    <EventInputs>
      <Event Comment="go" Name="REQ" Type="Event">
        <With Var="X"/>
      </Event>
    </EventInputs>
    <EventOutputs>
      <Event Name="CNF" Type="Event"><With Var="Y"/><Attribute Name="Z" Value="1"/></Event>
    </EventOutputs>
    <InputVars>
      <VarDeclaration Comment="m" InitialValue="2.5" Name="X" Type="LREAL"/>
      <VarDeclaration ArraySize="4" Name="DT" Type="TIME"/>
    </InputVars>
    <OutputVars>
      <VarDeclaration Name="Y" Type="LREAL"><Attribute Name="Visible" Value="false"/></VarDeclaration>
    </OutputVars>
  </InterfaceList>
  <BasicFB>
    <InternalVars>
      <VarDeclaration ArraySize="1..3" InitialValue="[1, 2, 3]" Name="K" Type="INT"/>
    </InternalVars>
    <ECC>
      <ECState Comment="Initial" Name="START" x="475.0" y="1125.5"/>
      <ECState Name="RUN" x="1" y="2"><ECAction Algorithm="SCALE" Output="CNF"/></ECState>
      <ECTransition Condition="REQ[X &gt; 0.0]" Destination="RUN" Source="START" x="840.0" y="920.0"/>
      <ECTransition Condition="1" Destination="START" Source="RUN"/>
    </ECC>
    <Algorithm Comment="c" Name="SCALE">
      <ST Text="Y := X&#10;  * K[2];"/>
    </Algorithm>
  </BasicFB>
  <Attribute Name="eclipse4diac::core::TypeHash" Value="''"/>
</FBType>
"""
Write = Callable[..., Path]


def line_of(text: str, path: Path) -> int:
    content = path.read_text(encoding="utf-8")
    return content[: content.index(text)].count("\n") + 1
