"""A small block type with service sequences: one that holds, one that does not, and a draft."""

from __future__ import annotations

from pathlib import Path

HOLDS = """<ServiceSequence Name="counts"><ServiceTransaction>
<InputPrimitive Interface="COUNTER" Event="CU" Parameters="R:=FALSE"/>
<OutputPrimitive Interface="COUNTER" Event="CUO" Parameters="CV:=1;Q:=FALSE"/></ServiceTransaction>
<ServiceTransaction><InputPrimitive Interface="COUNTER" Event="CU"/>
<OutputPrimitive Interface="COUNTER" Event="CUO" Parameters="CV:=2;Q:=TRUE"/>
</ServiceTransaction></ServiceSequence>"""
WRONG = """<ServiceSequence Name="wrong"><ServiceTransaction><InputPrimitive Interface="COUNTER" Event="CU"/>
<OutputPrimitive Interface="COUNTER" Event="CUO" Parameters="CV:=3"/></ServiceTransaction></ServiceSequence>"""
DRAFT = """<ServiceSequence Name="draft"><ServiceTransaction>
<InputPrimitive Interface="COUNTER" Event="INIT+"/></ServiceTransaction></ServiceSequence>"""
COUNTER = """<?xml version="1.0" encoding="UTF-8"?>
<FBType Name="COUNTER" Comment="Counts up">
  <InterfaceList>
    <EventInputs><Event Name="CU"><With Var="R"/><With Var="PV"/></Event></EventInputs>
    <EventOutputs><Event Name="CUO"><With Var="CV"/><With Var="Q"/></Event></EventOutputs>
    <InputVars>
      <VarDeclaration Name="R" Type="BOOL"/>
      <VarDeclaration Name="PV" Type="INT" InitialValue="2"/>
    </InputVars>
    <OutputVars><VarDeclaration Name="CV" Type="INT"/><VarDeclaration Name="Q" Type="BOOL"/></OutputVars>
  </InterfaceList>
  <BasicFB>
    <ECC>
      <ECState Name="START"/>
      <ECState Name="COUNT"><ECAction Algorithm="UP" Output="CUO"/></ECState>
      <ECState Name="RESET"><ECAction Algorithm="ZERO" Output="CUO"/></ECState>
      <ECTransition Source="START" Destination="RESET" Condition="CU[R]"/>
      <ECTransition Source="START" Destination="COUNT" Condition="CU"/>
      <ECTransition Source="COUNT" Destination="START" Condition="1"/>
      <ECTransition Source="RESET" Destination="START" Condition="1"/>
    </ECC>
    <Algorithm Name="UP"><ST><![CDATA[CV := CV + 1;
IF CV >= PV THEN
  Q := TRUE;
ELSE
  Q := FALSE;
END_IF;]]></ST></Algorithm>
    <Algorithm Name="ZERO"><ST><![CDATA[CV := 0;
Q := FALSE;]]></ST></Algorithm>
  </BasicFB>
  <Service LeftInterface="COUNTER" RightInterface="RESOURCE">SEQUENCES</Service>
</FBType>
"""


def write_counter(folder: Path, *sequences: str) -> Path:
    """The file of the type in a folder, with the sequences given."""
    file = folder / "COUNTER.fbt"
    file.write_text(COUNTER.replace("SEQUENCES", "".join(sequences)))
    return file
