"""Projects of 4diac IDE: the libraries that they link to, and the constants that a file imports."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.files.names import ImportingNames, resolved
from iec61499.files.project import linked_folders, project_of
from iec61499.library import Library
from iec61499.lint.check import check
from iec61499.lint.settings import Settings
from iec61499.mapping import resource_network
from iec61499.runtime.resource import Resource
from tests.support.iec61499.networks import network

PROJECT = """<projectDescription><linkedResources>
<link><name>Lib</name><type>2</type><locationURI>virtual:/virtual</locationURI></link>
<link><name>Lib/a</name><type>2</type><locationURI>WORKSPACE_LOC/.lib/a-1.0.0/typelib</locationURI></link>
<link><name>Lib/b</name><type>2</type><locationURI>ECLIPSE_HOME/typelibrary/b%20c</locationURI></link>
<link><name>Lib/d</name><type>2</type><locationURI>PARENT-2-PROJECT_LOC/d</locationURI></link>
<link><name>Lib/up</name><type>2</type><locationURI>WORKSPACE_LOC/../outside</locationURI></link>
<link><name>Lib/M</name><type>1</type><locationURI>WORKSPACE_LOC/.lib/a-1.0.0/MANIFEST.MF</locationURI></link>
</linkedResources></projectDescription>"""
LIMITS = """<GlobalConstants Name="LIMITS"><CompilerInfo packageName="plant"/>
<GlobalConstants><VarDeclaration Name="HIGH" Type="INT" InitialValue="40"/></GlobalConstants></GlobalConstants>"""
DOUBLE = """<FBType Name="DOUBLE"><CompilerInfo><Import declaration="plant::LIMITS::HIGH"/></CompilerInfo>
<InterfaceList><EventInputs><Event Name="REQ"/></EventInputs><EventOutputs><Event Name="CNF"/></EventOutputs>
<InputVars><VarDeclaration Name="X" Type="INT" InitialValue="HIGH"/></InputVars>
<OutputVars><VarDeclaration Name="Y" Type="INT"/></OutputVars></InterfaceList>
<SimpleFB><Algorithm Name="REQ"><ST>Y := X + high;</ST></Algorithm></SimpleFB></FBType>"""
SYSTEM = """<System Name="my-plant"><CompilerInfo><Import declaration="plant::LIMITS::HIGH"/></CompilerInfo>
<Application Name="APP"><SubAppNetwork><FB Name="D" Type="plant::DOUBLE"/>
<FB Name="E" Type="DOUBLE"><Parameter Name="X" Value="HIGH"/></FB>
<EventConnections><Connection Source="D.CNF" Destination="E.REQ"/></EventConnections></SubAppNetwork></Application>
<Device Name="PC" Type="FORTE_PC"><Resource Name="RES" Type="EMB_RES"/></Device>
<Mapping From="APP.D" To="PC.RES"/><Mapping From="APP.E" To="PC.RES"/></System>"""


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project in a workspace, and the folders around it that it links to."""
    made = tmp_path / "all" / "workspace" / "plant"
    for folder in (
        made,
        tmp_path / "all" / "workspace" / ".lib" / "a-1.0.0" / "typelib",
        tmp_path / "home" / "typelibrary" / "b c",
        tmp_path / "all" / "d",
        tmp_path / "all" / "outside",
    ):
        folder.mkdir(parents=True)
    monkeypatch.setenv("ECLIPSE_HOME", str(tmp_path / "home"))
    (made / ".project").write_text(PROJECT)
    return made


def test_links_lead_to_folders_that_are_there(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    around = project.parents[1]
    library = around / "workspace" / ".lib" / "a-1.0.0" / "typelib"
    assert linked_folders(project) == (library, around.parent / "home" / "typelibrary" / "b c", around / "d")
    monkeypatch.delenv("ECLIPSE_HOME")
    assert linked_folders(project) == (library, around / "d")
    assert linked_folders(library) == ()
    (project / ".project").write_text("<projectDescription>")
    with pytest.raises(FunctionBlockError, match="not well-formed XML"):
        Library([project])


def test_types_and_constants_come_from_libraries_that_a_project_links_to(project: Path) -> None:
    library = project.parent / ".lib" / "a-1.0.0" / "typelib"
    (library / "LIMITS.gcf").write_text(LIMITS)
    (library / "DOUBLE.fbt").write_text(DOUBLE)
    (project / "plant.sys").write_text(SYSTEM)
    found = Library([project])
    system = found.load_system(project / "plant.sys")
    assert system.header.name == "my-plant"
    resource = Resource(resource_network(system), found)
    resource.trigger("D.REQ")
    resource.run_until_idle()
    assert (resource.read("D.Y"), resource.read("E.X"), resource.read("E.Y")) == (80, 40, 80)


def test_the_project_s_own_type_counts_and_a_constant_that_is_not_imported_does_not(project: Path) -> None:
    library = project.parent / ".lib" / "a-1.0.0" / "typelib"
    (library / "LIMITS.gcf").write_text(LIMITS)
    (library / "DOUBLE.fbt").write_text(DOUBLE)
    (project / "DOUBLE.fbt").write_text(DOUBLE.replace("<Import", "<Exclude"))
    with pytest.raises(FunctionBlockError, match=r"plant/DOUBLE\.fbt.*'HIGH' is not a INT"):
        Library([project]).find("DOUBLE")


@pytest.mark.parametrize(
    ("text", "name", "reason"),
    [
        ("Y := X + plant::LIMITS::HIGH;", "plant::LIMITS::HIGH", r"there is no file LIMITS\.gcf: searched .*plant"),
        ("Y := X + high;", "high", r"it is imported as plant::LIMITS::HIGH, and there is no file LIMITS\.gcf"),
        ("Y := X + KNOWN::LOW;", "KNOWN::LOW", r".*KNOWN\.gcf declares no LOW"),
        (
            "Y := X + TOP;",
            "TOP",
            r".*KNOWN\.gcf declares it, which is not imported: expected KNOWN::TOP or an import",
        ),
    ],
)
def test_a_constant_without_its_file_or_its_import_is_named_with_its_place(
    project: Path, text: str, name: str, reason: str
) -> None:
    (project / "KNOWN.gcf").write_text(LIMITS.replace("LIMITS", "KNOWN").replace("HIGH", "TOP"))
    block = DOUBLE.replace('InitialValue="HIGH"', "").replace("Y := X + high;", f"\n  {text}")
    (project / "DOUBLE.fbt").write_text(block)
    line = block[: block.index(text)].count("\n") + 1
    place = rf"DOUBLE\.fbt:{line}:12: unknown constant {name}: {reason}"
    with pytest.raises(FunctionBlockError, match=place):
        Resource(network("D: DOUBLE"), Library([project]))


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("LIMITS::HIGH", "or a constant: none of that name is in the file LIMITS.gcf"),
        ("HIGH", "or a constant: none of that name is in a file of constants (.gcf) that is imported"),
    ],
)
def test_a_value_without_its_constant_is_named_with_its_place(project: Path, value: str, reason: str) -> None:
    (project / "DOUBLE.fbt").write_text(DOUBLE.replace('InitialValue="HIGH"', f'InitialValue="{value}"'))
    with pytest.raises(FunctionBlockError) as refused:
        Library([project]).find("DOUBLE")
    assert f"DOUBLE.fbt:3: '{value}' is not a INT" in str(refused.value)
    assert str(refused.value).endswith(reason)


TAGS = """<virtualDNS:VirtualDNSManagement xmi:version="2.0" xmlns:xmi="http://www.omg.org/XMI"
xmlns:virtualDNS="org.eclipse.fordiac.ide.virtualDNS"
activeVirtualDNS="//@availableDNSCollections.1">
<availableDNSCollections name="Home"><virtualDNSEntries name="COUNT" value="1"/></availableDNSCollections>
<availableDNSCollections name="Plant"><virtualDNSEntries name="COUNT" value="UINT#7"/>
<virtualDNSEntries name="HOST" value="127.0.0.1"/></availableDNSCollections></virtualDNS:VirtualDNSManagement>"""
TAGGED = """<System Name="s"><Application Name="A"><SubAppNetwork>
<FB Name="N" Type="E_CTU"><Parameter Name="PV" Value="%COUNT%"/></FB>
<FB Name="P" Type="PUBLISH_0"><Parameter Name="ID" Value="'%HOST%:%PORT%'"/></FB></SubAppNetwork></Application>
<Device Name="D" Type="FORTE_PC"><Resource Name="R" Type="EMB_RES"/></Device>
<Mapping From="A.N" To="D.R"/><Mapping From="A.P" To="D.R"/></System>"""


def test_names_of_the_project_have_the_values_of_its_active_collection(tmp_path: Path) -> None:
    (tmp_path / ".project").write_text("<projectDescription/>")
    (tmp_path / "virtualDNS.dns").write_text(TAGS)
    folder = tmp_path / "systems"
    folder.mkdir()
    file = folder / "s.sys"
    file.write_text(TAGGED)
    library = Library([tmp_path])
    blocks = {block.name: block for block in resource_network(library.load_system(file), "D.R").blocks}
    assert [parameter.value for parameter in blocks["N"].parameters] == ["UINT#7"]
    assert [parameter.value for parameter in blocks["P"].parameters] == ["'127.0.0.1:%PORT%'"]
    (folder / ".project").write_text("<projectDescription/>")
    with pytest.raises(FunctionBlockError, match="'%COUNT%' is not a UINT"):
        Resource(resource_network(library.load_system(file), "D.R"), library)


AX = """<AdapterType Name="AX"><InterfaceList><EventOutputs><Event Name="E1"/></EventOutputs></InterfaceList>
</AdapterType>"""
USER = """<FBType Name="USER"><InterfaceList><Plugs><AdapterDeclaration Name="P" Type="adapter::AX"/></Plugs>
</InterfaceList><BasicFB><ECC><ECState Name="S"/></ECC></BasicFB></FBType>"""


def test_a_library_has_the_types_of_those_that_it_needs_beside_it(tmp_path: Path) -> None:
    libraries = tmp_path / ".lib"
    for name, needed in (("io-3.0.0", "adapter"), ("adapter-3.0.0", "io")):
        (libraries / name / "typelib").mkdir(parents=True)
        required = f'<Required SymbolicName="{needed}" Version="3.0.0"/><Required SymbolicName="../up" Version="1"/>'
        (libraries / name / "MANIFEST.MF").write_text(f"<Manifest><Dependencies>{required}</Dependencies></Manifest>")
    (libraries / "adapter-3.0.0" / "typelib" / "AX.adp").write_text(AX)
    file = libraries / "io-3.0.0" / "typelib" / "USER.fbt"
    file.write_text(USER)
    assert project_of(file) == libraries / "io-3.0.0"
    assert linked_folders(project_of(file)) == (libraries / "adapter-3.0.0", libraries / "io-3.0.0")
    assert [finding.rule for finding in check([file], None, "embedded", Settings())] == []


def test_a_library_that_names_none_has_those_of_all_beside_it(tmp_path: Path) -> None:
    libraries = tmp_path / ".lib"
    for name in ("io-3.0.0", "adapter-3.0.0"):
        (libraries / name / "typelib").mkdir(parents=True)
        (libraries / name / "MANIFEST.MF").write_text("<Manifest/>")
    (libraries / "notes").mkdir()
    (libraries / "adapter-3.0.0" / "typelib" / "AX.adp").write_text(AX)
    file = libraries / "io-3.0.0" / "typelib" / "USER.fbt"
    file.write_text(USER)
    assert linked_folders(project_of(file)) == (libraries / "adapter-3.0.0", libraries / "io-3.0.0")
    assert check([file], None, "embedded", Settings()) == []


def test_a_file_in_no_project_has_the_types_of_the_folder_given(tmp_path: Path) -> None:
    (tmp_path / "types").mkdir()
    (tmp_path / "adapters").mkdir()
    (tmp_path / "adapters" / "AX.adp").write_text(AX)
    file = tmp_path / "types" / "USER.fbt"
    file.write_text(USER)
    assert [finding.rule for finding in check([file], None, "embedded", Settings())] == ["invalid"]
    assert check([file], None, "embedded", Settings(), [tmp_path]) == []


def test_the_types_of_a_foreign_project_are_beside_its_file_and_what_it_draws_is_no_part(tmp_path: Path) -> None:
    (tmp_path / "Plant.dfbproj").write_text("<Project/>")
    file = tmp_path / "System" / "System.sys"
    file.parent.mkdir()
    drawn = '<Frame Name="F"/><Input Name="REQ" x="1" y="2"/><Output Name="CNF"/>'
    file.write_text(SYSTEM.replace("plant::LIMITS::HIGH", "LIMITS::HIGH").replace("<FB Name", f"{drawn}<FB Name", 1))
    (tmp_path / "DOUBLE.fbt").write_text(DOUBLE)
    (tmp_path / "LIMITS.gcf").write_text(LIMITS)
    assert project_of(file) == tmp_path
    names = [block.name for block in resource_network(Library([tmp_path]).load_system(file)).blocks]
    assert names == ["START", "D", "E"]


def test_constants_inside_lists_and_structures_are_those_that_are_imported(tmp_path: Path) -> None:
    (tmp_path / "LIMITS.gcf").write_text(LIMITS)
    values = "[1, HIGH, INT#3]"
    text = DOUBLE.replace(
        'Name="X" Type="INT" InitialValue="HIGH"',
        f'Name="X" Type="INT"/><VarDeclaration Name="L"\
 Type="INT" ArraySize="3" InitialValue="{values}"',
    )
    (tmp_path / "DOUBLE.fbt").write_text(text)
    block = Library([tmp_path]).find("DOUBLE")
    assert [variable.initial for variable in block.interface.inputs if variable.name == "L"] == ["[1, 40, INT#3]"]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("(HIGH := HIGH, T := 'HIGH', C := plant::LIMITS::HIGH)", "(HIGH := 40, T := 'HIGH', C := 40)"),
        ("[2(HIGH), COLOUR#HIGH, MAX(HIGH)]", "[2(40), COLOUR#HIGH, MAX(40)]"),
        ("'HIGH'", "'HIGH'"),
        ("HIGH", "40"),
        ("LOW", "LOW"),
    ],
)
def test_a_constant_stands_for_its_value_where_a_value_may_stand(tmp_path: Path, text: str, value: str) -> None:
    (tmp_path / "LIMITS.gcf").write_text(LIMITS)
    names = ImportingNames(Library([tmp_path]), ["plant::LIMITS::HIGH"], "")
    assert resolved(text, names) == value
