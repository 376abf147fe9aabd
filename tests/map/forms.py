"""Small exports of every form, written for the tests: {name: bytes}. They describe, as far as the
form can, the same three values: Start (I0.0 BOOL), Speed (MW10 INT), Name."""


def asc(symbol, address, kind, comment=""):
    return ("126," + symbol.ljust(24) + address.ljust(12) + kind.ljust(10) + comment.ljust(80)).encode(
        "cp1252")


def dif(rows):
    text = 'TABLE\n0,1\n"EXCEL"\nVECTORS\n0,%d\n""\nTUPLES\n0,4\n""\nDATA\n0,0\n""\n' % len(rows)
    for row in rows:
        text += "-1,0\nBOT\n" + "".join('1,0\n"%s"\n' % c.replace('"', '""') for c in row)
    return (text + "-1,0\nEOD\n").encode("cp1252")


ROWS = [("Start", "E       0.0", "BOOL", 'start "now"; \u00fcber'), ("Speed", "MW     10", "INT", "speed"),
        ("Tank", "DB     10", "DB     10", "a block"), ("Clock", "T       5", "TIMER", "")]

XML_TAGS = """\ufeff<?xml version='1.0' encoding='utf-8'?>
<Tagtable name='t'>
 <Tag type='Bool' hmiVisible='True' hmiWriteable='True' hmiAccessible='True' addr='%I0.0' remark='start "now"; \u00fcber'>Start</Tag>
 <Tag type='Int' addr='%MW10' remark='speed'>Speed</Tag>
</Tagtable>
"""
OPENNESS = """<?xml version="1.0" encoding="utf-8"?>
<Document><SW.Tags.PlcTagTable ID="0"><AttributeList><Name>t</Name></AttributeList><ObjectList>
<SW.Tags.PlcTag ID="1"><AttributeList><DataTypeName>Bool</DataTypeName><LogicalAddress>%I0.0</LogicalAddress>
<Name>Start</Name></AttributeList><ObjectList><MultilingualText ID="2"><ObjectList>
<MultilingualTextItem ID="3"><AttributeList><Culture>de-DE</Culture><Text>Los</Text></AttributeList></MultilingualTextItem>
<MultilingualTextItem ID="4"><AttributeList><Culture>en-US</Culture><Text>start "now"; \u00fcber</Text></AttributeList></MultilingualTextItem>
</ObjectList></MultilingualText></ObjectList></SW.Tags.PlcTag>
<SW.Tags.PlcTag ID="5"><AttributeList><Name>Speed</Name><LogicalAddress>%MW10</LogicalAddress>
<DataTypeName>Int</DataTypeName></AttributeList><ObjectList><MultilingualText ID="6"><ObjectList>
<MultilingualTextItem ID="7"><AttributeList><Culture>en-US</Culture><Text>speed</Text></AttributeList></MultilingualTextItem>
</ObjectList></MultilingualText></ObjectList></SW.Tags.PlcTag>
</ObjectList></SW.Tags.PlcTagTable></Document>
"""
OPENNESS_DB = """<?xml version="1.0" encoding="utf-8"?>
<Document><SW.Blocks.GlobalDB ID="0"><AttributeList><Interface><Sections xmlns="http://www.siemens.com/automation/Openness/SW/Interface/v4">
<Section Name="Static">
 <Member Name="Run" Datatype="Bool"><Comment><MultiLanguageText Lang="en-US">runs</MultiLanguageText></Comment></Member>
 <Member Name="Set" Datatype="Struct"><Member Name="Speed" Datatype="Int"/><Member Name="Ramp" Datatype="Array[1..3] of Real"/></Member>
 <Member Name="Name" Datatype="String[10]"/>
</Section></Sections></Interface><MemoryLayout>%s</MemoryLayout><Name>Motor</Name><Number>12</Number></AttributeList>
</SW.Blocks.GlobalDB></Document>
"""
SOURCE = """\ufeffTYPE "Drive"
VERSION : 0.1
   STRUCT
      Run : Bool;   // runs
      Speed : Int := 5;   // speed
      "01" : Array[1..2] of Bool;
   END_STRUCT;
END_TYPE

DATA_BLOCK "Motor"
{ S7_Optimized_Access := 'FALSE' }
VERSION : 0.1
NON_RETAIN
   STRUCT
      Left : "Drive";
      Both : Array[0..1] of "Drive";
      Name : String[9];   // name
      Where : Any;
      Last : Byte;
   END_STRUCT;
BEGIN
   Left.Run := TRUE;
END_DATA_BLOCK
"""
ROCKWELL_CSV = """remark,"CSV-Import-Export"
remark,"Version = RSLogix 5000"
0.3
TYPE,SCOPE,NAME,DESCRIPTION,DATATYPE,SPECIFIER,ATTRIBUTES
TAG,,Start,"start $Qnow$Q; $00FCber","BOOL","","(RADIX := Decimal)"
TAG,,Speed,"speed","INT[2,3]","","(RADIX := Decimal)"
TAG,Main,Drive,"a drive","Drive","",""
ALIAS,,Shown,"","","Local:1:I.Data.0",""
COMMENT,,Drive,"runs","","Drive.Run",""
"""
L5K = """\ufeff(* an export *)
IE_VER := 2.28;

CONTROLLER P (ProcessorType := "1756-L72",
              Major := 37)
\tDATATYPE Drive (FamilyType := NoFamily)
\t\tSINT ZZZZZZZZZZDrive0 (Hidden := 1);
\t\tBIT Run ZZZZZZZZZZDrive0 : 0 (Description := "runs");
\t\tREAL Ramp[3];
\tEND_DATATYPE

\tADD_ON_INSTRUCTION_DEFINITION Ramp (Revision := "1.0")
\t\tPARAMETERS
\t\t\tEnableIn : BOOL (Usage := Input, Required := No);
\t\t\tOut : REAL (Description := "value", Usage := Output) := 0.0;
\t\t\tTable : REAL[9] (Usage := InOut);
\t\tEND_PARAMETERS
\t\tLOCAL_TAGS
\t\t\told : REAL (RADIX := Float);
\t\tEND_LOCAL_TAGS
\t\tROUTINE Logic
\t\tEND_ROUTINE
\tEND_ADD_ON_INSTRUCTION_DEFINITION

\tMODULE Local (Parent := "Local")
\t  TAG := nothing;
\tEND_MODULE

\tTAG
\t\tRamp1 : Ramp := [1,2.0];
\t\tWait : TIMER := [0,0,0];
\t\tStart : BOOL (Description := "start $Qnow$Q",
\t\t              RADIX := Decimal) := 0;
\t\tSpeed : INT[2,3] := [1,2,3,4,5,6];
\t\tLeft : Drive (COMMENT.RUN := "left runs") := [0,[1.0,2.0,3.0]];
\t\tShown OF Local:1:I.Data.0 (RADIX := Decimal);
\tEND_TAG
\tPROGRAM Main (MAIN := "R")
\t\tTAG
\t\t\tCount : DINT := 0;
\t\tEND_TAG
\tEND_PROGRAM
END_CONTROLLER
"""
L5X = """\ufeff<?xml version="1.0" encoding="UTF-8" standalone="yes"?>
<RSLogix5000Content SchemaRevision="1.0"><Controller Use="Target" Name="P">
<DataTypes><DataType Name="Drive" Family="NoFamily" Class="User"><Members>
<Member Name="ZZZZZZZZZZDrive0" DataType="SINT" Dimension="0" Hidden="true"/>
<Member Name="Run" DataType="BIT" Dimension="0" Hidden="false" Target="ZZZZZZZZZZDrive0" BitNumber="0">
<Description><![CDATA[runs]]></Description></Member>
<Member Name="Ramp" DataType="REAL" Dimension="3" Hidden="false"/>
</Members></DataType></DataTypes>
<AddOnInstructionDefinitions><AddOnInstructionDefinition Name="Ramp"><Parameters>
<Parameter Name="EnableIn" TagType="Base" DataType="BOOL" Usage="Input"/>
<Parameter Name="Out" TagType="Base" DataType="REAL" Usage="Output"><Description><![CDATA[value]]></Description></Parameter>
<Parameter Name="Table" TagType="Base" DataType="REAL" Dimensions="9" Usage="InOut"/></Parameters>
<LocalTags><LocalTag Name="old" DataType="REAL"/></LocalTags></AddOnInstructionDefinition></AddOnInstructionDefinitions>
<Tags>
<Tag Name="Ramp1" TagType="Base" DataType="Ramp"/>
<Tag Name="Wait" TagType="Base" DataType="TIMER"/>
<Tag Name="Start" TagType="Base" DataType="BOOL"><Description><![CDATA[start "now"]]></Description></Tag>
<Tag Name="Speed" TagType="Base" DataType="INT" Dimensions="2 3"/>
<Tag Name="Left" TagType="Base" DataType="Drive"><Comments><Comment Operand=".RUN"><![CDATA[left runs]]></Comment></Comments></Tag>
<Tag Name="Shown" TagType="Alias" AliasFor="Local:1:I.Data.0"/>
</Tags>
<Programs><Program Name="Main"><Tags><Tag Name="Count" TagType="Base" DataType="DINT"/></Tags></Program></Programs>
</Controller></RSLogix5000Content>
"""
TMC = """\ufeff<?xml version="1.0" encoding="utf-8"?>
<TcModuleClass><DataTypes>
<DataType><Name>T_Text</Name><BitSize>88</BitSize><BaseType>STRING(10)</BaseType></DataType>
<DataType><Name Namespace="Lib">Drive</Name><BitSize>96</BitSize>
 <SubItem><Name>Run</Name><Type>BOOL</Type><Comment><![CDATA[ runs]]></Comment><BitSize>8</BitSize><BitOffs>0</BitOffs></SubItem>
 <SubItem><Name>Name</Name><Type>T_Text</Type><BitSize>88</BitSize><BitOffs>8</BitOffs></SubItem>
 <SubItem><Name>Id</Name><Type>GUID</Type><BitSize>128</BitSize><BitOffs>192</BitOffs></SubItem>
 <SubItem><Name>Next</Name><Type PointerTo="1">Drive</Type><BitSize>64</BitSize><BitOffs>128</BitOffs></SubItem>
</DataType></DataTypes>
<Modules><Module><DataAreas><DataArea><Name>a</Name>
<Symbol><Name>GVL.Left</Name><BitSize>96</BitSize><BaseType Namespace="Lib">Drive</BaseType><BitOffs>0</BitOffs></Symbol>
<Symbol><Name>GVL.Speed</Name><BitSize>48</BitSize><BaseType>INT</BaseType><ArrayInfo><LBound>1</LBound><Elements>3</Elements></ArrayInfo><BitOffs>96</BitOffs></Symbol>
</DataArea></DataAreas></Module></Modules></TcModuleClass>
"""
CODESYS = """<?xml version="1.0" encoding="utf-8"?>
<Symbolconfiguration xmlns="http://www.3s-software.com/schemas/Symbolconfiguration.xsd">
<TypeList>
<TypeSimple name="T_BOOL" size="1" typeclass="Bool" iecname="BOOL"/>
<TypeSimple name="T_STRING" size="11" typeclass="String" iecname="STRING"/>
<TypeSimple name="T_INT" size="2" typeclass="Int" iecname="INT"/>
<TypeArray name="T_A" basetype="T_INT" iecname="ARRAY [1..3] OF INT"><ArrayDim minrange="1" maxrange="3"/></TypeArray>
<TypeUserDef name="T_Drive" size="12" nativesize="12" typeclass="Userdef" iecname="Drive">
<UserDefElement iecname="Run" type="T_BOOL" byteoffset="0"><Comment>runs</Comment></UserDefElement>
<UserDefElement iecname="Name" type="T_STRING" byteoffset="1"/></TypeUserDef>
</TypeList>
<NodeList><Node name="Application"><Node name="GVL">
<Node name="Left" type="T_Drive" access="ReadWrite"/><Node name="Speed" type="T_A" access="ReadWrite"/>
</Node></Node></NodeList></Symbolconfiguration>
"""
PLCOPEN = """<?xml version="1.0" encoding="utf-8"?>
<project xmlns="http://www.plcopen.org/xml/tc6_0200"><types><dataTypes>
<dataType name="Drive"><baseType><struct><variable name="Run"><type><BOOL/></type></variable>
<variable name="Name"><type><string length="10"/></type></variable></struct></baseType></dataType>
</dataTypes><pous/></types><instances><configurations><configuration name="c"><globalVars>
<variable name="Left"><type><derived name="Drive"/></type></variable>
<variable name="Speed"><type><array><dimension lower="1" upper="3"/><baseType><INT/></baseType></array></type></variable>
</globalVars></configuration></configurations></instances></project>
"""
FORMS = {
    "asc": b"\r\n".join(asc(*r) for r in ROWS) + b"\r\n",
    "sdf": "".join('"%s","%s","%s","%s"\r\n' % (s.ljust(24), a.ljust(12), k.ljust(10),
                                                c.replace('"', '""').ljust(20))
                   for s, a, k, c in ROWS).encode("cp1252"),
    "semicolons": "".join('%s;  %s;  %s;  "%s"\n' % (s, a, k, c.replace('"', '""'))
                          for s, a, k, c in ROWS).encode("cp1252"),
    "seq": "".join("\t%s\t%s\t%s\r" % (a, s, c) for s, a, k, c in ROWS).replace("\r", "\r\n").encode(
        "cp1252"),
    "dif": dif(ROWS),
    "tia.xml": XML_TAGS.encode("utf-8"),
    "tia.sdf": ('"Start","%I0.0","Bool","True","True","False","start ""now""; \u00fcber","","True"\n'
                '"Speed","%MW10","Int","True","True","False","speed","","True"\n').encode("utf-8"),
    "openness": OPENNESS.encode("utf-8"),
}
OTHERS = {
    "openness db": (OPENNESS_DB % "Standard").encode("utf-8"),
    "source": SOURCE.encode("utf-8"),
    "iec": b"(*@PROPERTIES_EX@\nTYPE: POU\n*)\nTYPE\n  Drive : STRUCT\n    Run : BOOL; (* runs *)\n"
           b"    Name : STRING(10);\n  END_STRUCT;\n  Mode : (Off, On);\nEND_TYPE\n",
    "outline": b"DB12\n000.0: STATIC: STRUCT\n000.0: \tSTAT0: STRUCT\n000.0: \t\tRun: BOOL := True\n"
               b"000.1: \t\tStop: BOOL\n002.0: \t\tRows: ARRAY [1..2] OF STRUCT\n002.0: \t\t\tA: BYTE\n"
               b"004.0: \t\t\tB: INT := 5\n010.0: \t\tName: STRING[9] := ''x''\n021.0: \t\tLast: BYTE",
    "offsets": b"Name\tData type\tOffset\tComment\n Static\t\t\t\nRun\tBool\t0.0\truns\nSpeed\tInt\t2.0\t\n"
               b"Ramp\tArray[1..3] of Real\t4.0\t\nLate\tInt\t...\t\n",
    "plain offsets": b"0 Run BOOL\n2 Speed INT\n+4.0 Name STRING[10]\n",
    "explorer": b"DEVICE,BLOCK,VARIABLE,CODE\nPLC,Tank,Run,DB6:20.1\nPLC,Tank,Speed,DB6:22 INT\n",
    "pcworx": b"%MX1.2016.0;BOOL;STD_CNF STD_RES RUN;runs\n%MW1.20;INT;STD_CNF SPEED;\n",
    "rockwell csv": ROCKWELL_CSV.encode("utf-8"),
    "L5K": L5K.encode("utf-8"),
    "L5X": L5X.encode("utf-8"),
    "tmc": TMC.encode("utf-8"),
    "codesys": CODESYS.encode("utf-8"),
    "plcopen": PLCOPEN.encode("utf-8"),
}
