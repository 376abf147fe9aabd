"""A map of a controller with tags: every type, members, elements, bits, structures, texts."""
MAP = '''symbol,plc,type,dir,pv,desc,egu,prec,lolo,low,high,hihi,states,raw,eng
Level,Level,REAL,in,Level,level,%,1,5,10,90,95,,,
SP,Tank.SP,REAL,out,SP,setpoint,C,1,,,,,,,
Count,Program:Main.Count,DINT,in,Cnt,,,,,,1000,,,,
Mode,Mode,INT,out,Mode,,,,,,,,stop|run|7=service!MAJOR,,
Raw,Raw,INT,in,Raw,,%,1,,5,95,,,0..27648,0..100
RawSP,Tank.RawSP,INT,out,RawSP,,%,1,,,,,,0..27648,0..100
B0,Flags[0],BOOL,in,B0,,,,,,,,ok|BAD!MAJOR,,
B33,Flags[33],BOOL,in,B33,,,,,,,,,,
B34,Flags[34],BOOL,out,B34,,,,,,,,,,
S3,Status.3,BOOL,in,S3,,,,,,,,,,
S4,Status.4,BOOL,in,S4,,,,,,,,,,
S31,Status.31,BOOL,in,S31,,,,,,,,,,
St,Status,DINT,in,St,,,,,,,,,,
Run,Run,BOOL,in,Run,,,,,,,,off|on,,
Go,Go,BOOL,cmd,Go,,,,,,,,off|on,,
Name,Name,STRING[82],in,Name,,,,,,,,,,
Recipe,Recipe,STRING[20],out,Recipe,,,,,,,,,,
Ramp,Ramp,ARRAY[0..9] OF REAL,in,Ramp,,,,,,,,,,
RampSP,RampSP,ARRAY[0..3] OF DINT,out,RampSP,,,,,,,,,,
Cell,"Table[1,2]",INT,in,Cell,,,,,,,,,,
V1,Valves[3],VALVE,in,V1:,valve 1,,,,,,,,,
V2,Valves[4],VALVE,in,V2:,valve 2,,,,,,,,,
Bits,Bits,ARRAY[0..39] OF BOOL,in,Bit,,,,,,,,,,
Big,Big,LINT,in,Big,,,,,,,,,,
UBig,UBig,ULINT,out,UBig,,,,,,,,,,
U32,U32,UDINT,out,U32,,,,,,,,,,
U16,U16,UINT,in,U16,,,,,,,,,,
Small,Small,SINT,in,Small,,,,,,,,,,
USmall,USmall,USINT,out,USmall,,,,,,,,,,
W,W,WORD,in,W,,,,,,,,,,
DW,DW,DWORD,in,DW,,,,,,,,,,
L,L,LREAL,out,L,,,,,,,,,,
Long,Long,ARRAY[0..249] OF REAL,in,Long,,,,,,,,,,
Matrix,Matrix,"ARRAY[0..19,0..9] OF DINT",in,Matrix,,,,,,,,,,
'''
TYPES = '''type,field,ftype,at,suffix,dir,desc,egu,high,states
VALVE,Open,BOOL,,,,open,,,
,Fault,BOOL,,,,fault,,,ok|FAULT!MAJOR
,Cycles,DINT,,,,cycles,,,
,Pos,REAL,,,,position,%,95,
,Name,STRING[12],,,,name,,,
,Trace,ARRAY[0..3] OF INT,,,,trace,,,
,Set,REAL,,,out,set,,,
'''
PLC = '''key,value
name,CTRL
wire,etherip
family,none
prefix,e:
'''


def write(folder, **changes):
    """A folder with it; changes: map=, plc=, types= in place of its sheets."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (("map", MAP), ("plc", PLC), ("types", TYPES)):
        (folder / (name + ".csv")).write_text(changes.get(name, text), encoding="utf-8")
    return folder
